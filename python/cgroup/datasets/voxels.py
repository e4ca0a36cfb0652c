"""One point per occupied cell of a grid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from cgroup.types import FloatArray


def voxel_means(points: FloatArray, size: float) -> FloatArray:
    """Mean of the points in each occupied cell, ordered by cell.

    Parameters
    ----------
    points : (N,3) array of float64
        Whole cloud.
    size : float
        Edge length of a cell, in the data's unit.

    Returns
    -------
    (M,3) array of float64
        M <= N.
    """
    cells = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
    _, rows = np.unique(cells, axis=0, return_inverse=True)
    rows = rows.reshape(-1)
    counts = np.bincount(rows)
    return np.stack([np.bincount(rows, weights=points[:, axis]) / counts for axis in range(3)], axis=1)
