"""RCS-72: outlines of the local surface, seen from six sides."""

import numpy as np

from .neighborhood import FloatArray, ball
from .shot_lrf import toldi_lrf


def rcs(points: FloatArray, keypoint: int, *, radius: float) -> FloatArray:
    """Descriptor (72,) of one keypoint; zero where it has no frame."""
    frame = toldi_lrf(points, keypoint, radius=radius, inner_share=0.5, signed=True)
    if np.isnan(frame).any():
        return np.zeros(72)
    local = (points[ball(points, keypoint, radius)] - points[keypoint]) @ frame.T
    return np.concatenate([contour(local @ turned(np.radians(30 * k)).T, radius) for k in range(6)])


def turned(angle: float) -> FloatArray:
    """Return the passive rotation by the same angle about z, then y, then x."""
    c, s = np.cos(angle), np.sin(angle)
    about_z = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    about_y = np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
    about_x = np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    return about_x @ about_y @ about_z


def contour(local: FloatArray, radius: float) -> FloatArray:
    """Greatest planar distance, in radii, in the first 16 of every 30 degrees."""
    degrees = np.floor(np.degrees(np.arctan2(local[:, 1], local[:, 0])) % 360).astype(int)
    planar = np.hypot(local[:, 0], local[:, 1]) / radius
    result = np.zeros(12)
    for m in range(12):
        counted = planar[(degrees // 30 == m) & (degrees % 30 <= 15)]
        result[m] = counted.max(initial=0)
    return result
