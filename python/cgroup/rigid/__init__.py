"""Rigid transforms: 4x4 matrices of column vectors, p' = R p + t.

``T_target_source`` maps points of the source into the frame of the target. Transforms are chained by the
matrix product: ``T_map_scan2 @ T_scan2_scan1`` maps scan 1 into the map.
"""

from cgroup.rigid.transforms import (
    RIGID_TOLERANCE,
    apply,
    check_rigid,
    invert,
    rotation_error,
    translation_error,
)

__all__ = ["RIGID_TOLERANCE", "apply", "check_rigid", "invert", "rotation_error", "translation_error"]
