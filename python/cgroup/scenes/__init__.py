"""Many scans: their poses in one scene, scans in maps, and pose graphs."""

from cgroup.maps.assess_in_map import assess_in_map
from cgroup.maps.locate import locate
from cgroup.maps.prepared_map import PreparedMap, prepare_map
from cgroup.pose_graph import PoseGraph
from cgroup.scenes.false_joins import false_joins
from cgroup.scenes.register_all import register_all
from cgroup.scenes.scene import Edge, Scene

__all__ = [
    "Edge", "PoseGraph", "PreparedMap", "Scene", "assess_in_map", "false_joins", "locate", "prepare_map",
    "register_all",
]  # fmt: skip
