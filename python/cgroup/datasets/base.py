"""What a data set consists of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cgroup.io import PointCloud
    from cgroup.types import FloatArray


@dataclass(frozen=True, eq=False)
class MatchingPair:
    """Two clouds of the same thing and the pose between them.

    Attributes
    ----------
    name : str
        Short, unique within its data set.
    source, target : PointCloud
        In the same unit, each in its own frame.
    T_target_source : (4,4) array of float64
        True pose: maps source points into the target's frame.
    """

    name: str
    source: PointCloud
    target: PointCloud
    T_target_source: FloatArray
