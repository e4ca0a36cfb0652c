"""SC2-PCR: second-order spatial compatibility (Chen et al., CVPR 2022; not of the paper).

With delta_ij = |ds_ij - dt_ij|, D the bound on it, all matrices with their diagonal:

    S  = max(0, 1 - delta^2 / D^2)      soft
    H  = [delta < D]                    hard
    Ht = [delta < D / 2]                tight
    C  = (Ht Ht) o H                    second order
    v  = S^10 1, normalised             confidence

Seeds are the matches with no greater confidence within `nms_radius` in the source, then the others, each by
confidence, `seed_ratio` n in all. The set of a seed has the k1 best by its row of C, then of these the k2 best by the
seed's row of H H within them. Weights w = S'^10 1 with S' the soft matrix of the set, its diagonal 0; its pose is the
weighted Kabsch motion. The pose with the most inliers is refined (see `refinement`).

With `candidates` c_i1, c_i2, ... of each match (SC2-PCR++, TPAMI 2023), each of the 50 poses with the most inliers is
refined by one round; let i be in K where some |T p_i - c_ij| < t, and c_i the first c_ij within 1.5 t. The pose with the
greatest max over i in K of #{j in K : ||p_i - p_j| - |c_i - c_j|| < D / 2} is refined to the end.

Decisions where the source is open
----------------------------------
* Ten power steps always; the published code stops early where a step changes nothing within 1e-5.
* Confidences are compared in units of 1e-9 of the greatest; ties go to the lowest index. The published code
  takes the matches that are no maxima in any order.
* At least one seed. The seed itself comes first in its set; then ties go to the lowest index, and in the second
  stage to the better one of the first.
* Only matches with C > 0 become members; the published code fills a set up to k1 with any.
* Members of weight 0 are left out; a set that does not determine a rotation has no pose.
* The bound D / 2 of SC2-PCR++ is a constant of its own in the published code: as here for rooms, D for streets.
* The group has the inliers of the refined pose; the scores are the confidences.
"""

import numpy as np
from numpy.typing import ArrayLike

from .pairwise import centred, distance_difference, edge_lengths
from .refinement import best_pose, inliers_of, refine, residuals
from .result import FloatArray, IntArray, ReferenceGrouping, as_rows, length
from .rigid import Pose, apply, fixes_rotation, in_data, weighted_kabsch

POWER_STEPS = 10
TIE = 1e-9
BEST = 50


def sc2pcr(
    source: ArrayLike,
    target: ArrayLike,
    *,
    candidates: ArrayLike | None = None,
    resolution: float | None = None,
    tolerance: float | None = None,
    max_distance_difference: float | None = None,
    seed_ratio: float = 0.2,
    nms_radius: float | None = None,
    k1: int = 30,
    k2: int = 20,
) -> ReferenceGrouping:
    p_raw, q_raw = as_rows(source, 3), as_rows(target, 3)
    p, q, n = centred(p_raw), centred(q_raw), len(p_raw)
    t = length(tolerance, resolution, 5.0)
    limit = t if max_distance_difference is None else max_distance_difference
    delta = distance_difference(p, q)
    confidence = leading_eigenvector(soft(delta, limit))
    if n == 0:
        return ReferenceGrouping(np.zeros(0, dtype=bool), confidence, None)
    hard, tight = delta < limit, (delta < limit / 2.0).astype(np.float32)
    most = max(1, int(n * seed_ratio))
    poses = []
    for seed in pick_seeds(p, confidence, t if nms_radius is None else nms_radius, most):
        second_order = (tight[seed] @ tight) * hard[seed]
        members = best_of(second_order, k1, seed)
        local = hard[np.ix_(members, members)].astype(np.int64)
        members = members[np.argsort(-(local[0] @ local), kind="stable")[:k2]]
        pose = pose_of(p[members], q[members], soft(delta[np.ix_(members, members)], limit))
        if pose is not None:
            poses.append(pose)
    if candidates is None or np.size(candidates) == 0:
        best = best_pose(poses, p, q, t)
    else:
        others = np.array(candidates, dtype=np.float64) - q_raw.mean(axis=0)
        best = best_by_candidates(poses, p, q, others, t, limit)
    pose = None if best is None else refine(best, p, q, t)
    details = {"transform": None if pose is None else in_data(pose, p_raw, q_raw)}
    return ReferenceGrouping(inliers_of(pose, p, q, t), confidence, None, details)


def soft(delta: FloatArray, limit: float) -> FloatArray:
    return np.maximum(0.0, 1.0 - (delta / limit) ** 2)


def leading_eigenvector(matrix: FloatArray) -> FloatArray:
    """(n,) ten power steps from equal entries, of unit length; 0 where the matrix is."""
    vector = np.ones(len(matrix))
    for _ in range(POWER_STEPS):
        vector = matrix @ vector
        size = np.linalg.norm(vector)
        if size == 0.0:
            break
        vector = vector / size
    return vector


def pick_seeds(p: FloatArray, confidence: FloatArray, radius: float, most: int) -> IntArray:
    rounded = np.rint(confidence / (TIE * confidence.max()))
    near = edge_lengths(p) < radius
    is_maximum = ~(near & (rounded[None, :] > rounded[:, None])).any(axis=1)
    return np.lexsort((-rounded, ~is_maximum))[:most]


def best_of(second_order: FloatArray, most: int, seed: int) -> IntArray:
    """Return the seed and the others with the greatest positive entries."""
    order = np.argsort(-second_order, kind="stable")
    others = order[(second_order[order] > 0.0) & (order != seed)]
    return np.concatenate([[seed], others[: most - 1]])


def pose_of(p: FloatArray, q: FloatArray, compatibility: FloatArray) -> Pose | None:
    """Return the weighted least-squares motion of a set, if it determines one."""
    np.fill_diagonal(compatibility, 0.0)
    weight = leading_eigenvector(compatibility)
    kept = weight > 0.0
    if not fixes_rotation(p[kept], q[kept]):
        return None
    return weighted_kabsch(p[kept], q[kept], weight[kept])


def best_by_candidates(
    poses: list[Pose], p: FloatArray, q: FloatArray, candidates: FloatArray, tolerance: float, limit: float
) -> Pose | None:
    """Return the pose whose candidates keep their distances best, refined by one round."""
    counts = np.array([(residuals(pose, p, q) < tolerance).sum() for pose in poses], dtype=np.int64)
    order = np.argsort(-counts, kind="stable")[:BEST]
    refined = [refine(poses[k], p, q, tolerance, rounds=1) for k in order if counts[k] > 0]
    scores = [agreeing_candidates(pose, p, candidates, tolerance, limit / 2.0) for pose in refined]
    return refined[int(np.argmax(scores))] if max(scores, default=0) > 0 else None


def agreeing_candidates(
    pose: Pose, p: FloatArray, candidates: FloatArray, tolerance: float, limit: float
) -> int:
    """Return the greatest number of candidates that keep their distance to one of them."""
    moved = apply(pose.rotation, pose.translation, p)
    r = np.linalg.norm(candidates - moved[:, None, :], axis=2)
    rows = np.flatnonzero((r < tolerance).any(axis=1))
    if len(rows) == 0:
        return 0
    first = (r < 1.5 * tolerance).argmax(axis=1)[rows]
    return int((distance_difference(p[rows], candidates[rows, first]) < limit).sum(axis=1).max())
