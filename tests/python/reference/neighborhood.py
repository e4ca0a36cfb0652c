"""Neighbourhoods by brute force: all points nearer than a radius, or the k nearest."""

import numpy as np
from numpy.typing import NDArray

from .result import FloatArray


def ball(points: FloatArray, center: int, radius: float) -> NDArray[np.intp]:
    """Rows of the points nearer than `radius` to row `center`, itself included, by (distance, row)."""
    distance = np.linalg.norm(points - points[center], axis=1)
    rows = np.flatnonzero(distance < radius)
    return rows[np.lexsort((rows, distance[rows]))]


def nearest(points: FloatArray, center: int, count: int) -> NDArray[np.intp]:
    """Rows of the `count` points nearest to row `center`, itself first, by (distance, row)."""
    distance = np.linalg.norm(points - points[center], axis=1)
    distance[center] = -1
    return np.lexsort((np.arange(len(points)), distance))[:count]


def local_maxima(
    points: FloatArray, scores: FloatArray, radius: float, *, least: int = 1, break_ties: bool = False
) -> list[int]:
    """Rows whose score no point nearer than `radius` exceeds, with `least` points around them."""
    kept = []
    for i in range(len(points)):
        near = ball(points, i, radius)
        if len(near) < least or np.any(scores[near] > scores[i]):
            continue
        if break_ties and np.any((scores[near] == scores[i]) & (near < i)):
            continue
        kept.append(i)
    return kept
