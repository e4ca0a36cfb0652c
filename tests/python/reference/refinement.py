"""From the poses of a method to its group: the choice of one, and its last refinement (SC2-PCR, MAC, TurboReg).

    inliers : sum of [r_i < t]
    mae     : sum of max(0, 1 - r_i / t)
    mse     : sum of max(0, 1 - r_i / t)^2
    refine  : T = argmin sum over r_i < t of |T p_i - q_i|^2 / (1 + (r_i / t)^2), until the number of inliers stays

Decisions where the sources are open
------------------------------------
* Ties go to the first pose; no pose is taken that has no inlier.
* Refinement ends after 20 rounds, or where the inliers do not determine a rotation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .rigid import apply, homogeneous

if TYPE_CHECKING:
    from .result import BoolArray, FloatArray

ROUNDS = 20
FLAT = 1e-7


class Pose(NamedTuple):
    """R p + t between the centred points."""

    rotation: FloatArray
    translation: FloatArray


def residuals(pose: Pose, p: FloatArray, q: FloatArray) -> FloatArray:
    """(n,) r_i."""
    return np.linalg.norm(apply(pose.rotation, pose.translation, p) - q, axis=1)


def weighted_kabsch(p: FloatArray, q: FloatArray, weight: FloatArray) -> Pose:
    """Weighted least-squares motion."""
    p_mean, q_mean = np.average(p, axis=0, weights=weight), np.average(q, axis=0, weights=weight)
    u, _, vt = np.linalg.svd(((p - p_mean) * weight[:, None]).T @ (q - q_mean))
    rotation = vt.T @ np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
    return Pose(rotation, q_mean - rotation @ p_mean)


def fixes_rotation(p: FloatArray, q: FloatArray) -> bool:
    """Return True for three points or more that lie on a line on neither side."""
    if len(p) < 3:
        return False
    spread = [np.linalg.svd(x - x.mean(axis=0), compute_uv=False) for x in (p, q)]
    return all(s[1] > FLAT * s[0] for s in spread)


def triangle_poses(p: FloatArray, q: FloatArray) -> list[Pose]:
    """Least-squares motions of triangles (m,3,3), of those that lie on a line on neither side."""
    p_mean, q_mean = p.mean(axis=1, keepdims=True), q.mean(axis=1, keepdims=True)
    spread = [np.linalg.svd(x, compute_uv=False) for x in (p - p_mean, q - q_mean)]
    kept = np.logical_and(*(s[:, 1] > FLAT * s[:, 0] for s in spread))
    p, q, p_mean, q_mean = p[kept], q[kept], p_mean[kept, 0], q_mean[kept, 0]
    u, _, vt = np.linalg.svd(np.swapaxes(p - p_mean[:, None], 1, 2) @ (q - q_mean[:, None]))
    vt[:, 2] *= np.linalg.det(u @ vt)[:, None]
    rotations = np.swapaxes(u @ vt, 1, 2)
    return [
        Pose(rotation, end - rotation @ start)
        for rotation, start, end in zip(rotations, p_mean, q_mean, strict=True)
    ]


def best_pose(
    poses: list[Pose], p: FloatArray, q: FloatArray, tolerance: float, choice: str = "inliers"
) -> Pose | None:
    """Return the first pose with the greatest score, unless that is 0."""
    scores = np.zeros(len(poses))
    for k, pose in enumerate(poses):
        r = residuals(pose, p, q)
        if choice == "inliers":
            scores[k] = (r < tolerance).sum()
        else:
            scores[k] = (np.maximum(0.0, 1.0 - r / tolerance) ** (1 if choice == "mae" else 2)).sum()
    return poses[int(scores.argmax())] if scores.max(initial=0.0) > 0.0 else None


def refine(pose: Pose, p: FloatArray, q: FloatArray, tolerance: float, rounds: int = ROUNDS) -> Pose:
    """Weighted least squares over the inliers, until their number stays."""
    count = 0
    for _ in range(rounds):
        r = residuals(pose, p, q)
        inliers = r < tolerance
        if inliers.sum() == count or not fixes_rotation(p[inliers], q[inliers]):
            break
        count = inliers.sum()
        pose = weighted_kabsch(p[inliers], q[inliers], 1.0 / (1.0 + (r[inliers] / tolerance) ** 2))
    return pose


def inliers_of(pose: Pose | None, p: FloatArray, q: FloatArray, tolerance: float) -> BoolArray:
    """(n,) True for residuals below the tolerance."""
    return np.zeros(len(p), dtype=bool) if pose is None else residuals(pose, p, q) < tolerance


def in_data(pose: Pose, p_raw: FloatArray, q_raw: FloatArray) -> FloatArray:
    """(4,4) the motion in the caller's coordinates."""
    shift = pose.translation + q_raw.mean(axis=0) - pose.rotation @ p_raw.mean(axis=0)
    return homogeneous(pose.rotation, shift)
