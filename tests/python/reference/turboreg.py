"""TurboReg: triangles around heavy pairs (Yan et al., ICCV 2025; not of the paper).

With delta_ij = |ds_ij - dt_ij| and D the bound on it:

    A     = [delta < D and ds + dt > nms_radius]      compatibility
    W     = (A A) o A, i < j                          second order
    pivot = the `pivots` heaviest (i, j) of W
    thirds of a pivot = the `cliques_per_pivot` best k > j with A_ik = A_jk = 1 by W_ij + W_ik + W_jk

Each triangle (i, j, k) has its Kabsch motion. The best by `choice` is refined (see `refinement`).

Decisions where the source is open
----------------------------------
* Ties go to the lowest (i, j), and to the lowest k. Pairs without a common neighbour are no pivots.
* Pivots with fewer thirds have fewer triangles; the published code takes other indices there.
* Poses are in this order: first each pivot's best triangle, then each one's second.
* Triangles on a line on either side have no pose.
"""

import numpy as np
from numpy.typing import ArrayLike

from .pairwise import centred, distance_difference, edge_lengths
from .refinement import best_pose, inliers_of, refine, triangle_poses
from .result import BoolArray, FloatArray, ReferenceGrouping, as_rows, length
from .rigid import in_data


def turboreg(
    source: ArrayLike,
    target: ArrayLike,
    *,
    resolution: float | None = None,
    tolerance: float | None = None,
    max_distance_difference: float | None = None,
    nms_radius: float | None = None,
    pivots: int = 2_000,
    cliques_per_pivot: int = 2,
    choice: str = "inliers",
) -> ReferenceGrouping:
    p_raw, q_raw = as_rows(source, 3), as_rows(target, 3)
    p, q = centred(p_raw), centred(q_raw)
    t = length(tolerance, resolution, 5.0)
    limit = 0.12 * t if max_distance_difference is None else max_distance_difference
    shortest = 1.5 * t if nms_radius is None else nms_radius
    joined = (distance_difference(p, q) < limit) & (edge_lengths(p) + edge_lengths(q) > shortest)
    corners = np.array(triangles(joined, pivots, cliques_per_pivot), dtype=int).reshape(-1, 3)
    poses = triangle_poses(p[corners], q[corners])
    best = best_pose(poses, p, q, t, choice)
    pose = None if best is None else refine(best, p, q, t)
    details = {"transform": None if pose is None else in_data(pose, p_raw, q_raw)}
    return ReferenceGrouping(inliers_of(pose, p, q, t), None, None, details)


def triangles(joined: BoolArray, pivots: int, thirds: int) -> list[tuple[int, int, int]]:
    """Return the best triangles of all pivots, then the second ones, ..."""
    adjacency = joined.astype(np.float32)
    weight: FloatArray = np.where(joined, adjacency @ adjacency, 0.0)
    upper = np.triu(weight, 1)
    rows, columns = np.nonzero(upper)
    order = np.argsort(-upper[rows, columns], kind="stable")[:pivots]
    found = []
    for i, j in zip(rows[order], columns[order], strict=True):
        candidates = np.flatnonzero(joined[i] & joined[j])
        candidates = candidates[candidates > j]
        best = np.argsort(-(weight[i, candidates] + weight[j, candidates]), kind="stable")[:thirds]
        found += [(rank, (int(i), int(j), int(k))) for rank, k in enumerate(candidates[best])]
    return [triangle for _, triangle in sorted(found, key=lambda entry: entry[0])]
