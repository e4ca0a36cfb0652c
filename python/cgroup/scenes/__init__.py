"""Scenes of many scans: pose graphs."""

from cgroup.scenes.pose_graph import PoseGraph

__all__ = ["PoseGraph"]
