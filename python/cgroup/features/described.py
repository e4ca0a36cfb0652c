"""Keypoints of a cloud with their frames and descriptors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgroup.types import FloatArray, IndexArray


@dataclass(frozen=True, eq=False)
class DescribedCloud:
    """Described keypoints; row i of each array is one keypoint.

    Attributes
    ----------
    indices : (m,) array of int64
        Rows of the cloud, ascending.
    points : (m,3) array of float64
        Positions.
    lrf : (m,3,3) array of float64
        SHOT's local reference frames, rows are the axes; NaN where there is none.
    descriptors : (m,d) array of float32
        All finite, none zero.
    resolution : float
        The unit pr that the radii were multiples of.
    centroid : (3,) array of float64
        Of the whole cloud.
    """

    indices: IndexArray
    points: FloatArray
    lrf: FloatArray
    descriptors: NDArray[np.float32]
    resolution: float
    centroid: FloatArray

    def __len__(self) -> int:
        return len(self.indices)

    def __repr__(self) -> str:
        return f"DescribedCloud(m={len(self)}, dimensions={self.descriptors.shape[1]})"
