"""Least-squares rigid motion between paired points (Kabsch).

Decisions where the paper is open
---------------------------------
* A set of pairs determines its rotation when the second singular value of H exceeds
  1e-9 times the first. Collinear or coincident points fail this test.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .result import FloatArray

RANK_TOLERANCE = 1e-9


def cross_covariance(source: FloatArray, target: FloatArray) -> FloatArray:
    """H = sum_i a_i b_i^T of the centred points; (..., m, 3) -> (..., 3, 3)."""
    a = source - source.mean(axis=-2, keepdims=True)
    b = target - target.mean(axis=-2, keepdims=True)
    return np.swapaxes(a, -1, -2) @ b


def kabsch(source: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation R (..., 3, 3) and translation t (..., 3) with R p + t close to p'.

    R = V diag(1, 1, det(V U^T)) U^T from H = U S V^T, and t = mean p' - R mean p.
    """
    u, _, v_transposed = np.linalg.svd(cross_covariance(source, target))
    v, u_transposed = np.swapaxes(v_transposed, -1, -2), np.swapaxes(u, -1, -2)
    signs = np.ones((*u.shape[:-2], 3))
    signs[..., 2] = np.linalg.det(v @ u_transposed)
    rotation = (v * signs[..., None, :]) @ u_transposed
    moved_mean = np.einsum("...ij,...j->...i", rotation, source.mean(axis=-2))
    return rotation, target.mean(axis=-2) - moved_mean


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
