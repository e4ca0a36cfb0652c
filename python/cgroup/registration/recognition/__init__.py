"""Recognize models in a scene: prepare all, propose poses, compare surfaces, accept the most probable."""
