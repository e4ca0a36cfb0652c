"""Recognise models in a scene: prepare all, propose poses, compare surfaces, take the surest first."""
