"""LFSH-30: histograms of depth, horizontal radius and deviation angle."""

import numpy as np

from .neighborhood import FloatArray, ball


def lfsh(points: FloatArray, normals: FloatArray, keypoint: int, *, radius: float) -> FloatArray:
    """Descriptor (30,) of one keypoint; zero with fewer than 6 points around it."""
    rows = ball(points, keypoint, radius)
    normal = normals[keypoint]
    if not np.isfinite(normal).all():
        return np.full(30, np.nan)
    if len(rows) < 6:
        return np.zeros(30)
    offsets = points[rows] - points[keypoint]
    heights = offsets @ normal
    horizontal = np.linalg.norm(offsets - heights[:, None] * normal, axis=1)
    angles = np.degrees(np.arccos(np.clip(normals[rows] @ normal, -1, 1)))
    shares = [
        histogram((radius + heights) / (2 * radius), 10),
        histogram(horizontal / radius, 5),
        histogram(angles[np.isfinite(angles)] / 180, 15),
    ]
    return np.concatenate(shares) / len(rows)


def histogram(values: FloatArray, bins: int) -> FloatArray:
    """Count values in 0..1; the last bin holds its upper end, and the keypoint's depth 0.5 opens bin 5."""
    return np.bincount(np.clip(np.floor(values * bins).astype(int), 0, bins - 1), minlength=bins)
