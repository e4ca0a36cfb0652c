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

import numpy as np

from .result import BoolArray, FloatArray
from .rigid import Pose, apply, fixes_rotation, kabsch, spreads, weighted_kabsch

ROUNDS = 20


def residuals(pose: Pose, p: FloatArray, q: FloatArray) -> FloatArray:
    return np.linalg.norm(apply(pose.rotation, pose.translation, p) - q, axis=1)


def triangle_poses(p: FloatArray, q: FloatArray) -> list[Pose]:
    """Least-squares motions of triangles (m,3,3), of those that lie on a line on neither side."""
    kept = spreads(p) & spreads(q)
    return [Pose(*pose) for pose in zip(*kabsch(p[kept], q[kept]), strict=True)]


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
    return np.zeros(len(p), dtype=bool) if pose is None else residuals(pose, p, q) < tolerance
