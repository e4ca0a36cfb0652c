"""Many scans: their poses in one scene, and pose graphs."""

from cgroup.scenes.pose_graph import PoseGraph
from cgroup.scenes.register_all import register_all
from cgroup.scenes.scene import Edge, Scene

__all__ = ["Edge", "PoseGraph", "Scene", "register_all"]
