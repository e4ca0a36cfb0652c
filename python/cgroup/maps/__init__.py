"""Maps in which scans are located; `cgroup.scenes` shows the public names."""

from cgroup.maps.locate import locate
from cgroup.maps.prepared_map import PreparedMap, prepare_map

__all__ = ["PreparedMap", "locate", "prepare_map"]
