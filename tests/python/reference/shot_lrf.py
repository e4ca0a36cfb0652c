"""SHOT's local reference frame, and TOLDI's with the variant that RCS uses."""

import numpy as np

from .neighborhood import FloatArray, ball
from .normals import plane

NONE = np.full((3, 3), np.nan)
FLAT = 1e-9


def shot_lrf(points: FloatArray, keypoint: int, *, radius: float) -> FloatArray:
    """Rows x, y, z at one keypoint; NaN with fewer than 5 neighbours apart from it."""
    offsets = points[ball(points, keypoint, radius)] - points[keypoint]
    offsets = offsets[np.any(offsets != 0, axis=1)]  # in order of distance
    if len(offsets) < 5:
        return NONE
    weights = radius - np.linalg.norm(offsets, axis=1)
    _, vectors = np.linalg.eigh((weights[:, None] * offsets).T @ offsets / weights.sum())
    inwards = points.mean(axis=0) - points[keypoint]
    x, z = (
        towards_most(axis if axis @ inwards >= 0 else -axis, offsets, FLAT * radius)
        for axis in (vectors[:, 2], vectors[:, 0])
    )
    return np.array([x, np.cross(z, x), z])


def towards_most(axis: FloatArray, offsets: FloatArray, flat: float) -> FloatArray:
    """Turn an axis to the side of most neighbours, on a tie of most of the five around the median.

    Neighbours to no side count as ahead.
    """
    along = offsets @ axis
    ahead = np.count_nonzero(along >= -flat)
    behind = len(along) - ahead
    if ahead == behind:
        middle = len(along) // 2
        return axis if np.count_nonzero(along[middle - 2 : middle + 3] > 0) >= 3 else -axis
    return axis if ahead > behind else -axis


def toldi_lrf(
    points: FloatArray, keypoint: int, *, radius: float, inner_share: float = 1 / 3, signed: bool = False
) -> FloatArray:
    """Rows x, y, z at one keypoint; NaN with fewer than 4 points in the inner ball or 11 in all."""
    inner = points[ball(points, keypoint, radius * inner_share)] - points[keypoint]
    outer = points[ball(points, keypoint, radius)] - points[keypoint]
    if len(inner) < 4 or len(outer) < 11:
        return NONE
    z, _ = plane(inner)
    if z @ inner.sum(axis=0) > 0:
        z = -z
    x = np.zeros(3)
    for offset in outer:
        height = offset @ z
        weight = (radius - np.linalg.norm(offset)) ** 2 * height**2 * (np.sign(height) if signed else 1)
        x += weight * (offset - height * z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])
