"""Single points far from all others."""

import numpy as np

from .own_axes import own_axes
from .result import FloatArray

FAR, ROOM, ALONE, MOST = 3.0, 0.5, 4, 0.05


def find_outliers(points: FloatArray) -> np.ndarray:
    """Return the rows of outliers; none if they are many."""
    turned = points @ own_axes(points).T
    center = np.median(turned, axis=0)
    size = float(np.quantile(np.linalg.norm(turned - center, axis=1), 0.9))
    far = np.flatnonzero((np.abs(turned - center) > FAR * size).any(axis=1))
    alone = np.ones(len(far), dtype=bool)
    for shift in (0.0, 0.5):  # points of a surface may be on both sides of a wall between two cubes
        cubes = np.floor((turned[far] - center) / (ROOM * size) + shift)
        _, rows, counts = np.unique(cubes, axis=0, return_inverse=True, return_counts=True)
        alone &= counts[rows.reshape(-1)] < ALONE
    return far[alone] if alone.sum() <= MOST * len(points) else far[:0]
