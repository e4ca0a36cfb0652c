"""What a data set consists of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from cgroup.io import PointCloud


@dataclass(frozen=True, eq=False)
class MatchingPair:
    """Two clouds of the same thing and the pose between them.

    Attributes
    ----------
    name : str
        Short, unique within its data set.
    source, target : PointCloud
        In the same unit, each in its own frame.
    T_target_source : ndarray, shape (4, 4)
        True pose: maps source points into the target's frame.
    """

    name: str
    source: PointCloud
    target: PointCloud
    T_target_source: NDArray[np.float64]
