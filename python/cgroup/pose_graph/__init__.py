"""Pose graphs, and their files; `cgroup.scenes` shows `PoseGraph`."""

from cgroup.pose_graph.pose_graph import PoseGraph

__all__ = ["PoseGraph"]
