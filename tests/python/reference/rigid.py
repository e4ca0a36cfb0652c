"""Least-squares rigid motion between paired points (Kabsch).

Decisions where the paper is open
---------------------------------
* A set of pairs determines its rotation when the second singular value of H exceeds
  1e-9 times the first. Collinear or coincident points fail this test.
"""

from typing import NamedTuple

import numpy as np

from .result import BoolArray, FloatArray

RANK_TOLERANCE = 1e-9
FLAT = 1e-7


class Pose(NamedTuple):
    """R p + t."""

    rotation: FloatArray
    translation: FloatArray


def cross_covariance(source: FloatArray, target: FloatArray) -> FloatArray:
    """H = sum_i a_i b_i^T of the centred points; (..., m, 3) -> (..., 3, 3)."""
    a = source - source.mean(axis=-2, keepdims=True)
    b = target - target.mean(axis=-2, keepdims=True)
    return np.swapaxes(a, -1, -2) @ b


def kabsch(source: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation R (..., 3, 3) and translation t (..., 3) = mean p' - R mean p with R p + t close to p'."""
    rotation = nearest_rotation(cross_covariance(source, target))
    moved_mean = np.einsum("...ij,...j->...i", rotation, source.mean(axis=-2))
    return rotation, target.mean(axis=-2) - moved_mean


def weighted_kabsch(p: FloatArray, q: FloatArray, weight: FloatArray) -> Pose:
    p_mean, q_mean = np.average(p, axis=0, weights=weight), np.average(q, axis=0, weights=weight)
    rotation = nearest_rotation(((p - p_mean) * weight[:, None]).T @ (q - q_mean))
    return Pose(rotation, q_mean - rotation @ p_mean)


def nearest_rotation(covariance: FloatArray) -> FloatArray:
    """R = V diag(1, 1, det(V U^T)) U^T from H = sum p q^T = U S V^T, (..., 3, 3)."""
    u, _, vt = np.linalg.svd(covariance)
    v, ut = np.swapaxes(vt, -1, -2), np.swapaxes(u, -1, -2)
    signs = np.ones((*u.shape[:-2], 1, 3))
    signs[..., 0, 2] = np.linalg.det(v @ ut)
    return (v * signs) @ ut


def spreads(points: FloatArray) -> BoolArray:
    """(...) True for points (..., m, 3) that are not on a line: second singular value above 1e-7 of the first."""
    spread = np.linalg.svd(points - points.mean(axis=-2, keepdims=True), compute_uv=False)
    return spread[..., 1] > FLAT * spread[..., 0]


def fixes_rotation(p: FloatArray, q: FloatArray) -> bool:
    """Return True for three points or more that lie on a line on neither side."""
    return len(p) >= 3 and bool(spreads(p) and spreads(q))


def determines_rotation(source: FloatArray, target: FloatArray) -> bool:
    """Return True when the pairs fix the rotation (rank of H is at least 2)."""
    singular = np.linalg.svd(cross_covariance(source, target), compute_uv=False)
    return bool(singular[1] > RANK_TOLERANCE * singular[0])


def apply(rotation: FloatArray, translation: FloatArray, points: FloatArray) -> FloatArray:
    """R p + t for (..., 3, 3), (..., 3) and (m, 3) -> (..., m, 3)."""
    return points @ np.swapaxes(rotation, -1, -2) + translation[..., None, :]


def homogeneous(rotation: FloatArray, translation: FloatArray) -> FloatArray:
    """(4,4) matrix of p' = R p + t on column vectors."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def in_data(pose: Pose, p_raw: FloatArray, q_raw: FloatArray, unit: float = 1.0) -> FloatArray:
    """(4,4) the motion of points centred and divided by `unit`, in the caller's coordinates."""
    shift = unit * pose.translation + q_raw.mean(axis=0) - pose.rotation @ p_raw.mean(axis=0)
    return homogeneous(pose.rotation, shift)
