"""Recognize models in a scene: prepare all, propose poses, compare surfaces, accept the most probable."""

from cgroup.recognition.recognize import Recognized, find_instances, recognize

__all__ = ["Recognized", "find_instances", "recognize"]
