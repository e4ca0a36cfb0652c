"""One point per occupied grid cell."""

import numpy as np

from cgroup.types import FloatArray

_MOST_CELLS = 1e6  # along an axis, so that the number of a cell fits into 64 bits


def voxel_means(points: FloatArray, size: float) -> FloatArray:
    """Return the mean point of each occupied grid cell, in the order of cells; `size` is the edge length."""
    above = points - points.min(axis=0)
    width = max(size, above.max() / _MOST_CELLS)
    cells = np.floor(above / width).astype(np.int64)
    extent = cells.max(axis=0) + 1
    numbers = (cells[:, 0] * extent[1] + cells[:, 1]) * extent[2] + cells[:, 2]
    _, rows = np.unique(numbers, return_inverse=True)
    counts = np.bincount(rows)
    return np.stack([np.bincount(rows, weights=points[:, axis]) / counts for axis in range(3)], axis=1)


def voxel_subset(points: FloatArray, count: int) -> FloatArray:
    """Return voxel means, with the cell size whose number of points is nearest to a given one."""
    if count == len(points):
        return points
    extent = float(np.ptp(points, axis=0).max())
    smallest, largest = extent / len(points), extent
    best = points
    for _ in range(30):
        size = float(np.sqrt(smallest * largest))
        means = voxel_means(points, size)
        if abs(len(means) - count) < abs(len(best) - count):
            best = means
        smallest, largest = (size, largest) if len(means) > count else (smallest, size)
    return best
