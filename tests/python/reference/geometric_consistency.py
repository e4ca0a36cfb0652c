"""GC: geometric consistency, Chen and Bhanu 2007 (paper 3.2, Eq. 13).

Decisions where the paper is open
---------------------------------
* star: strict delta < tolerance (Eq. 13), the seed always belongs to its cluster, no
  minimum size; so n = 1 selects its only row.
* clique: delta <= tolerance to every member so far. A seed scans all rows not yet
  taken in visiting order, those before the seed included. The set is found when its
  size is > min_cluster_size; only then are its members taken.
* clique: RANSAC gets the members of a found set in ascending row order (samples are
  index-based), with its strict <. The greatest filtered set wins, ties: first found;
  nothing found or everything filtered away: empty mask.
* clique: non-finite similarities are visited last, in index order.
* The scores are |G_i| for star and None for clique; the threshold is None.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .pairwise import distance_difference
from .ransac import ransac
from .result import BoolArray, FloatArray, IntArray, ReferenceGrouping, as_rows, length


def gc(
    source: ArrayLike,
    target: ArrayLike,
    *,
    resolution: float | None = None,
    tolerance: float | None = None,
    variant: Literal["star", "clique"] = "star",
    ties: Literal["lowest", "union"] = "lowest",
    similarity: ArrayLike | None = None,
    min_cluster_size: int = 3,
    seed: int = 0,
    iterations: int = 10_000,
) -> ReferenceGrouping:
    p, q = as_rows(source, 3), as_rows(target, 3)
    t_gc = length(tolerance, resolution, 3.0)
    delta = distance_difference(p, q)  # d(c_i, c_j), Eq. 13
    if variant == "star":
        return star(delta, t_gc, ties)

    sets = cliques(delta <= t_gc, visiting_order(len(p), similarity), min_cluster_size)
    best = np.zeros(0, dtype=np.int64)
    for members in sets:
        kept = ransac(p[members], q[members], tolerance=t_gc, iterations=iterations, seed=seed).mask
        if kept.sum() > len(best):
            best = members[kept]
    mask = np.zeros(len(p), dtype=bool)
    mask[best] = True
    return ReferenceGrouping(mask, None, None, {"sets": sets})


def star(delta: FloatArray, t_gc: float, ties: Literal["lowest", "union"]) -> ReferenceGrouping:
    """Largest cluster {i} and {j : delta_ij < t_gc}."""
    if len(delta) == 0:
        return ReferenceGrouping(np.zeros(0, dtype=bool), np.zeros(0), None)
    clusters = delta < t_gc
    np.fill_diagonal(clusters, val=True)  # G_i
    sizes = clusters.sum(axis=1)
    largest = np.flatnonzero(sizes == sizes.max())
    seeds = largest if ties == "union" else largest[:1]  # i* = argmax |G_i|
    mask = clusters[seeds].any(axis=0)
    return ReferenceGrouping(mask, sizes.astype(np.float64), None)


def visiting_order(n: int, similarity: ArrayLike | None) -> IntArray:
    """Rows by descending similarity, ties by index; input order without similarity."""
    if similarity is None:
        return np.arange(n)
    values = as_rows(similarity)
    return np.argsort(-np.where(np.isfinite(values), values, -np.inf), kind="stable")


def cliques(consistent: BoolArray, order: IntArray, min_cluster_size: int) -> list[IntArray]:
    """Disjoint sets of mutually consistent rows, each grown greedily from its seed."""
    taken = np.zeros(len(order), dtype=bool)
    found = []
    for first in order:
        if taken[first]:
            continue
        members = [first]
        for row in order:
            if row != first and not taken[row] and consistent[row, members].all():
                members.append(row)
        if len(members) > min_cluster_size:
            taken[members] = True
            found.append(np.sort(np.array(members)))
    return found
