"""Maps in which scans are located; `cgroup.scenes` shows the public names."""

from cgroup.maps.assess_in_map import assess_in_map
from cgroup.maps.locate import locate
from cgroup.maps.prepared_map import PreparedMap, prepare_map

__all__ = ["PreparedMap", "assess_in_map", "locate", "prepare_map"]
