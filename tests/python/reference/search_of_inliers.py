"""SI: search of inliers, Buch et al. 2014 (paper 3.1, Eq. 3 to 6).

Decisions where the paper is open
---------------------------------
* The nearest `neighbors` other source keypoints are ordered by (distance, index);
  coincident keypoints are ordinary neighbours at distance 0. There are min(neighbors,
  n - 1) of them.
* The list of global voters has min(neighbors, n) members, the same list for all i;
  i itself is then left out. So |C_G| is one less for the members of the list.
* A correspondence without frame fails all its own global tests but keeps its
  denominators; as a voter for others it needs no frame.
* global_rank="local_score" sorts by descending local score, ties by index.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .otsu import OtsuMode, select_above
from .pairwise import centred, distance_ratio, edge_lengths
from .result import BoolArray, FloatArray, ReferenceGrouping, as_rows, has_frame, length


def si(
    source: ArrayLike,
    target: ArrayLike,
    *,
    ratio: ArrayLike,
    source_lrf: ArrayLike,
    target_lrf: ArrayLike,
    resolution: float | None = None,
    tolerance: float | None = None,
    neighbors: int = 250,
    min_distance_ratio: float = 0.9,
    lowe_ratio: float = 0.8,
    global_rank: Literal["lowe", "local_score"] = "lowe",
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
) -> ReferenceGrouping:
    p, q, lowe = as_rows(source, 3), as_rows(target, 3), as_rows(ratio)
    delta = length(tolerance, resolution, 5.0)
    rigid = distance_ratio(p, q) > min_distance_ratio  # r(c_i, c_j) > varsigma

    # Initialisation and local voting.
    passes_lowe = lowe < lowe_ratio  # C_Ratio, Eq. 2
    near = nearest_others(p, neighbors)
    local_voters = near & passes_lowe[None, :]  # C_L(c) = C_Ratio and kappa nearest
    local_votes = local_voters & rigid  # Y_L(c), Eq. 3
    local_score = share(local_votes.sum(axis=1), local_voters.sum(axis=1))  # s_L(c)

    # Global voting.
    rank = lowe if global_rank == "lowe" else -local_score
    leaders = np.argsort(rank, kind="stable")[:neighbors]
    global_voters = np.zeros_like(near)
    global_voters[:, leaders] = True
    np.fill_diagonal(global_voters, val=False)  # C_G without c itself
    error = transfer_error(p, q, as_rows(source_lrf, 3, 3), as_rows(target_lrf, 3, 3))  # v_G, Eq. 4
    global_votes = global_voters & rigid & (error < delta)  # Y_G(c), Eq. 5

    votes = local_votes.sum(axis=1) + global_votes.sum(axis=1)
    voters = local_voters.sum(axis=1) + global_voters.sum(axis=1)
    scores = share(votes, voters)  # s(c), Eq. 6
    mask, cut = select_above(scores, threshold, otsu)
    return ReferenceGrouping(mask, scores, cut)


def nearest_others(points: FloatArray, count: int) -> BoolArray:
    """(n,n) row i: True for the `count` nearest other points of i, ties by index."""
    distance = edge_lengths(points)
    np.fill_diagonal(distance, np.inf)
    order = np.argsort(distance, axis=1, kind="stable")[:, : min(count, len(points) - 1)]
    near = np.zeros(distance.shape, dtype=bool)
    np.put_along_axis(near, order, values=True, axis=1)
    return near


def transfer_error(
    source: FloatArray, target: FloatArray, source_lrf: FloatArray, target_lrf: FloatArray
) -> FloatArray:
    """(n,n) v_G(c_i, c_j) = |T(c_i) p_j - p'_j|, Eq. 4; inf where i has no frame."""
    p, q = centred(source), centred(target)
    rotation = np.swapaxes(target_lrf, 1, 2) @ source_lrf  # R(p')^-1 R(p), rows are axes
    translation = q - np.einsum("iab,ib->ia", rotation, p)  # T(c_i) maps p_i to p'_i
    moved = np.einsum("iab,jb->ija", rotation, p) + translation[:, None, :]
    error = np.linalg.norm(moved - q[None, :, :], axis=2)
    error[~has_frame(source_lrf, target_lrf)] = np.inf
    return error


def share(votes: np.ndarray, voters: np.ndarray) -> FloatArray:
    return np.where(voters > 0, votes / np.maximum(voters, 1), 0.0)
