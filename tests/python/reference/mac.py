"""MAC: maximal cliques (Zhang et al., CVPR 2023, section 3; Yang et al., TPAMI 2024).

    w_ij = 1 - (1 - w_min) (delta_ij / d_max)^2 where delta_ij <= d_max, else 0    (Eq. 1, 2)
    W    = w o (w w)                                                               (Eq. 3)
    c_i  = sum_(j<k) (W_ij W_ik W_jk)^(1/3) / (deg_i (deg_i - 1) / 2)
    MAE  = sum over r_i < tolerance of (tolerance - r_i) / tolerance

Maximal cliques of the graph of W; each vertex keeps the one with the greatest sum of W over its pairs; each clique
that was kept proposes its Kabsch motion; the greatest MAE wins and is refined.

Decisions where the paper is open
---------------------------------
* The source has two kernels that are equal to first order, 1 - delta^2 / d_cmp^2 and exp(-delta^2 / (2 a^2)); this is the
  paper's, with d_max = d_cmp sqrt(1 - w_min). Equality with d_max agrees, so do coincident points.
* w is rounded to 15 binary digits and W to 16, downwards, so that sums are exact in any order. Pairs with W = 0 are none.
* The graph of more than 50 vertices is reduced where min(Otsu, mean, pooled) of c exceeds 3, as in the published code:
  Otsu's cut with its bins from 0 ("legacy"), pooled = the sum of the numerators over that of the denominators.
  Kept are c_i >= f max(Otsu, pooled) with the first f of 10, 9.95, 9.9, ... that 50 vertices reach. Cube roots
  and c are in single precision. Where all c are equal, Otsu's cut is that number.
* Of cliques of equal weight the one with the lower indices is the heavier one. Equal MAE: the heavier clique.
* Order of the search, which only shows where it is cut short: vertices by degree (ties to
  the lowest index), each with its later neighbours as candidates, if those and itself can make a clique; pivot: the
  neighbour of all members with the most candidates, those later in that order first, then by index; first the pivot's branch,
  then by index. The starts of each block of 32 get an equal share, one at least, of the max_cliques / starts ends that are left
  to all, maximal cliques (of any size) or dead ends.
* A clique on a line on either side proposes nothing. Choice and refinement: see `refinement`.
"""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .otsu import otsu_split
from .pairwise import centred, distance_difference
from .refinement import best_pose, residuals
from .refinement import refine as refine_pose
from .result import FloatArray, IntArray, ReferenceGrouping, as_rows, length
from .rigid import fixes_rotation, weighted_kabsch

LEAST_VERTICES = 50
BLOCK = 32

Clique = tuple[int, ...]


def mac(
    source: ArrayLike,
    target: ArrayLike,
    *,
    resolution: float | None = None,
    tolerance: float | None = None,
    max_distance_difference: float | None = None,
    min_weight: float = 0.99,
    min_clique_size: int = 3,
    max_cliques: int = 1_000_000,
    max_hypotheses: int | None = None,
    refine: bool = True,
) -> ReferenceGrouping:
    p, q = centred(as_rows(source, 3)), centred(as_rows(target, 3))
    tau = length(tolerance, resolution, 5.0)
    second = second_order(p, q, max_distance_difference or tau / 5.0, min_weight)
    kept = dense_part(second)
    found, complete = search(second, kept, min_clique_size, max_cliques)
    weights = {clique: int(second[np.ix_(clique, clique)].sum()) // 2 for clique in found}
    ranked = sorted(weights, key=lambda clique: (-weights[clique], clique))
    heaviest: dict[int, Clique] = {}
    for clique in ranked:
        for i in clique:
            heaviest.setdefault(i, clique)
    scores = np.array([weights[heaviest[i]] / 2**16 if i in heaviest else 0.0 for i in range(len(p))])
    chosen = set(heaviest.values())
    cliques = [list(clique) for clique in ranked if clique in chosen][:max_hypotheses]
    poses = [weighted_kabsch(p[c], q[c], np.ones(len(c))) for c in cliques if fixes_rotation(p[c], q[c])]
    best = best_pose(poses, p, q, tau, "mae")
    model = refine_pose(best, p, q, tau) if refine and best is not None else best
    mask = np.zeros(len(p), dtype=bool) if model is None else residuals(model, p, q) < tau
    details = {"complete": complete}
    return ReferenceGrouping(mask, scores, None, details)


def second_order(p: FloatArray, q: FloatArray, bound: float, min_weight: float) -> IntArray:
    """(n,n) W in units of 2^-16."""
    delta = distance_difference(p, q)
    share = np.minimum(delta / bound, 1.0)
    weight = np.floor((1.0 - (1.0 - min_weight) * share * share) * 2**15 + 0.5)
    w = np.where(delta <= bound, weight, 0.0).astype(np.int64)
    np.fill_diagonal(w, 0)
    return (w * (w @ w)) >> 29


def dense_part(second: IntArray) -> IntArray:
    n = len(second)
    if n <= LEAST_VERTICES:
        return np.arange(n)
    root = in_single(np.cbrt(second / 2**16))
    triangles = ((root @ root) * root).sum(axis=1) / 2.0
    degree = (second > 0).sum(axis=1)
    pairs = degree * (degree - 1) / 2.0
    c = in_single(np.divide(triangles, pairs, out=np.zeros(n), where=pairs > 0))
    pooled = in_single(triangles.sum() / max(1.0, pairs.sum()))
    _, cut = otsu_split(c, "legacy")
    otsu = c[0] if cut is None else cut
    if min(otsu, c.mean(), pooled) <= 3.0:
        return np.arange(n)
    reached = np.sort(c)[-LEAST_VERTICES]
    limits = (step / 20 * max(otsu, pooled) for step in range(200, -1, -1))
    limit = next(limit for limit in limits if limit <= reached)
    return np.flatnonzero(c >= limit)


def in_single(values: Any) -> Any:
    return np.float64(np.float32(values))


def search(second: IntArray, kept: IntArray, min_size: int, most: int) -> tuple[list[Clique], bool]:
    """Maximal cliques among the vertices, and whether these are all."""
    inside = np.isin(np.arange(len(second)), kept)
    joined = [set(np.flatnonzero((row > 0) & inside).tolist()) for row in second]
    order = sorted(kept.tolist(), key=lambda i: (len(joined[i]), i))
    rank = {i: place for place, i in enumerate(order)}
    starts = [i for i in order if sum(rank[j] > rank[i] for j in joined[i]) + 1 >= min_size]
    found: list[Clique] = []
    complete = True
    for first in range(0, len(starts), BLOCK):
        share = max(1, most // (len(starts) - first))
        for i in starts[first : first + BLOCK]:
            walk = from_vertex(i, joined, rank)
            ends = list(itertools.islice(walk, share))
            complete &= next(walk, None) is None
            most = max(0, most - len(ends))
            found += [clique for clique in ends if len(clique) >= min_size]
    return found, complete


def from_vertex(start: int, joined: list[set[int]], rank: dict[int, int]) -> Iterator[Clique]:
    """Yield the maximal cliques of a vertex and later ones, ascending, and () for each dead end."""
    later = {j for j in joined[start] if rank[j] > rank[start]}

    def extend(members: list[int], candidates: set[int], done: set[int]) -> Iterator[Clique]:
        if not candidates:
            yield () if done else tuple(sorted(members))
            return
        pivot = min(candidates | done, key=lambda u: (-len(joined[u] & candidates), u not in later, u))
        branches = sorted(candidates - joined[pivot], key=lambda u: (u != pivot, u))
        if not branches:
            yield ()
        for u in branches:
            yield from extend([*members, u], candidates & joined[u], done & joined[u])
            candidates, done = candidates - {u}, done | {u}

    return extend([start], later, joined[start] - later)
