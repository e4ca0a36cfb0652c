"""CLIPPER (Lusk, Fathian, How, ICRA 2021, Algorithm 1) and CLIPPER+ (Fathian, Summers, RA-L 2024).

    M_ij = exp(-delta_ij^2 / (2 sigma^2)) where delta_ij < epsilon and both edges exceed the least length,
           and where that is above 1e-4; M_ii = 1
    Z_ij = [M_ij = 0]
    F(u) = u' (M - d Z) u,  u >= 0, |u| = 1

    d    = mean of (M u)_i / (Z u)_i over u_i > 1e-9 and (Z u)_i > 1e-9, added up from round to round
    step u <- max(0, u + a g) / |..|, g = (M - d Z) u, a = 1, 1/4, 1/16, ... until F falls by at most 1e-9
    end  of a round: |du| < 1e-8, |dF| < 1e-9 F or 200 steps; of all: no such i, 1000 rounds, or a d of 1e9
    group: the round(F) largest u_i

Decisions where the sources are open
------------------------------------
* The start is M u0; u0_i is the first 64-bit word of ``numpy.random.Philox(counter=i, key=seed)``, its upper 53 bits in [0,1).
* Of equal u_i the lower index is larger; round goes half away from zero.
* M is rounded to float32. F ends a round by its relative change: it grows with the group (the published code: |dF| < 1e-9).
* maximum: M = 1 where it is not 0. The greedy clique H is that of `maximum_clique`; the ascent goes over the vertices
  with a core number of at least |H|, the last taken out first, from u0 = 0.01 random (in their order) on H, and that plus 1
  elsewhere, without a power step.
  What it finds is taken where it is a clique with more members; u is then 1/sqrt(m) on m members.
* Fewer than three selected, or on one line, are no group.
* certified: a clique, of as many members m as the greatest core number plus one, or at least as there are colours among the vertices
  of a core number of m at least.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .maximum_clique import color_classes, cores, greedy_clique
from .pairwise import centred, distance_difference, edge_lengths
from .result import BoolArray, FloatArray, IntArray, ReferenceGrouping, as_rows, length
from .rigid import homogeneous, kabsch, spreads

ZERO = 1e-9
NUDGES = (1e-13, 1e-11, 1e-9, 1e-7)
"""Relative, from the rounding of sums to that of the entries of M."""

SETTLED = 1e-3
LEAST_AFFINITY = 1e-4


class Ascent(NamedTuple):
    """Where an ascent ended, and whether one whose affinities differ by rounding ends elsewhere."""

    u: FloatArray
    objective: float
    unsettled: bool = False


def clipper(
    source: ArrayLike,
    target: ArrayLike,
    *,
    resolution: float | None = None,
    max_distance_difference: float | None = None,
    deviation: float | None = None,
    min_distance: float = 0.0,
    variant: str = "densest",
    seed: int = 0,
) -> ReferenceGrouping:
    p_raw, q_raw = as_rows(source, 3), as_rows(target, 3)
    p, q = centred(p_raw), centred(q_raw)
    epsilon = length(max_distance_difference, resolution, 5.0)
    sigma = epsilon / 3.0 if deviation is None else deviation
    delta = distance_difference(p, q)
    joined = (delta < epsilon) & (np.minimum(edge_lengths(p), edge_lengths(q)) > min_distance)
    joined &= np.exp(-(delta**2) / (2.0 * sigma**2)) > LEAST_AFFINITY
    if variant == "maximum":
        chosen, scores, unsettled = maximum(joined, seed)
    else:
        affinity = np.exp(-(delta**2) / (2.0 * sigma**2)).astype(np.float32) * joined + np.eye(len(p))
        excluded = ~joined & ~np.eye(len(p), dtype=bool)
        found = ascend_surely(affinity, excluded, affinity @ random_start(len(p), seed))
        chosen, scores, unsettled = largest(found), found.u, found.unsettled
    chosen = np.sort(chosen)
    details: dict[str, object] = {"certified": is_largest(chosen, joined), "unsettled": unsettled}
    mask = np.zeros(len(p), dtype=bool)
    if len(chosen) >= 3 and all(spreads(x[chosen]) for x in (p, q)):
        mask[chosen] = True
        details["transform"] = homogeneous(*kabsch(p_raw[chosen], q_raw[chosen]))
    return ReferenceGrouping(mask, scores, None, details)


def random_start(n: int, seed: int) -> FloatArray:
    words = [int(np.random.Philox(counter=i, key=seed).random_raw(1)[0]) for i in range(n)]
    return np.array([(word >> 11) * 2.0**-53 for word in words])


def ascend_surely(affinity: FloatArray, excluded: BoolArray, start: FloatArray) -> Ascent:
    """Ascend, also by affinities that differ a little: where cliques are alike, rounding decides between them.

    Two matches with the same points exclude each other and agree with the same others. A long step may set both to 0, after
    which only rounding parts them. So each difference is tried with both signs: if one favours the first, the other
    favours the second, and one of them ends elsewhere.
    """
    found = ascend(affinity, excluded, start)
    nudged = []
    for seed, nudge in enumerate(NUDGES):
        noise = np.random.default_rng(seed).uniform(-1.0, 1.0, size=affinity.shape)
        change = nudge * (noise + noise.T)
        nudged += [ascend(affinity * (1.0 + sign * change), excluded, start) for sign in (1.0, -1.0)]
    unsettled = any(
        abs(other.objective - found.objective) > SETTLED
        or (abs(other.u - found.u) > SETTLED * found.u.max(initial=0.0)).any()
        for other in nudged
    )
    return found._replace(unsettled=unsettled)


def ascend(affinity: FloatArray, excluded: BoolArray, start: FloatArray) -> Ascent:
    """Projected gradient ascent with a penalty on excluded pairs that grows."""
    norm = np.linalg.norm(start)
    u = start / norm if norm else start
    penalty, objective = ratio(affinity, excluded, u) or 0.0, 0.0
    for _ in range(1000):
        if penalty >= 1e9:
            break
        matrix = affinity - penalty * excluded
        gradient = matrix @ u
        objective = float(u @ gradient)
        for _ in range(200):
            u_new, value = step(matrix, u, gradient, objective)
            change, gain = np.linalg.norm(u_new - u), value - objective
            u, gradient, objective = u_new, matrix @ u_new, value
            if change < 1e-8 or abs(gain) < 1e-9 * abs(value):
                break
        more = ratio(affinity, excluded, u)
        if more is None:
            break
        penalty += more
    return Ascent(u, objective)


def step(
    matrix: FloatArray, u: FloatArray, gradient: FloatArray, objective: float
) -> tuple[FloatArray, float]:
    size, trial, value = 1.0, u, objective
    for _ in range(99):
        trial = np.maximum(0.0, u + size * gradient)
        norm = np.linalg.norm(trial)
        trial = trial / norm if norm else trial
        value = float(trial @ (matrix @ trial))
        if value - objective >= -ZERO:
            break
        size *= 0.25
    return trial, value


def ratio(affinity: FloatArray, excluded: BoolArray, u: FloatArray) -> float | None:
    """Return the mean of (M u) / (Z u) where both u and Z u are above 0."""
    conflict = excluded @ u
    active = (u > ZERO) & (conflict > ZERO)
    return float(((affinity @ u)[active] / conflict[active]).mean()) if active.any() else None


def largest(found: Ascent) -> IntArray:
    """Rows of the round(F) largest u."""
    return np.argsort(-found.u, kind="stable")[: int(np.floor(found.objective + 0.5))]


def maximum(joined: BoolArray, seed: int) -> tuple[IntArray, FloatArray, bool]:
    """Rows of a large clique, u, and whether rounding may decide which."""
    numbers, order = cores(joined)
    order = order[::-1]
    clique = greedy_clique(joined, order)
    kept = np.array([k for k in order if numbers[k] >= len(clique)], dtype=np.int64)
    unsettled = False
    if len(kept):
        inner = joined[np.ix_(kept, kept)]
        one = np.eye(len(kept), dtype=bool)
        start = ~np.isin(kept, clique) + 0.01 * random_start(len(kept), seed)
        found = ascend_surely((inner | one) * 1.0, ~inner & ~one, start)
        unsettled = found.unsettled
        rows = kept[largest(found)]
        if is_clique(rows, joined) and len(rows) > len(clique):
            clique = rows.tolist()
    scores = np.zeros(len(joined))
    scores[clique] = 1.0 / np.sqrt(max(len(clique), 1))
    return np.array(clique, dtype=np.int64), scores, unsettled


def is_clique(rows: IntArray, joined: BoolArray) -> bool:
    return bool((joined[np.ix_(rows, rows)] | np.eye(len(rows), dtype=bool)).all())


def is_largest(rows: IntArray, joined: BoolArray) -> bool:
    """Return True for a clique that bounds prove to be as large as any."""
    if len(rows) == 0 or not is_clique(rows, joined):
        return False
    numbers, order = cores(joined)
    if len(rows) == numbers.max() + 1:
        return True
    kept = [k for k in order[::-1] if numbers[k] >= len(rows)]
    return len(color_classes(joined, kept)) <= len(rows)
