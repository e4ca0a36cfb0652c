"""The axes that a cloud has by itself: principal ones, the longest first, towards the longer tails."""

import numpy as np

from .result import FloatArray


def own_axes(points: FloatArray) -> FloatArray:
    """Rotation (3,3) into the axes of some points."""
    offsets = points - points.mean(axis=0)
    first, second = np.linalg.eigh(offsets.T @ offsets)[1].T[:0:-1]
    first, second = (axis * (-1 if ((offsets @ axis) ** 3).sum() < 0 else 1) for axis in (first, second))
    return np.array([first, second, np.cross(first, second)])
