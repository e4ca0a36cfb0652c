"""RANSAC: random sampling consensus (paper 3.2).

Sampling: iteration `it` takes the first three 64-bit words of
``numpy.random.Philox(counter=it, key=seed)``. NumPy raises the counter before it makes
a block, so this is block it + 1 of Philox4x64-10 with the key (seed, 0). The three
words become three distinct indices by multiply-and-shift, see `draw`.

Decisions where the paper is open
---------------------------------
* Each side of a triple is judged against its own longest edge, so that one match far away
  changes nothing; that edge has to be above rounding: 1e-12 of the bounding-box diagonal.
* Early stop: checked after 256, 512, ... iterations with the best count so far; best
  = n stops at the first check, best = 0 never stops.
* refine replaces the motion by the refitted one whatever that does to the number of
  inliers. No refit when the inliers do not determine a rotation (fewer than three, or
  `rigid.determines_rotation` says no).
* No scores and no threshold are reported. details["transform"] is None for an empty
  group and is given in the caller's coordinates otherwise.
"""

import numpy as np
from numpy.typing import ArrayLike

from .pairwise import bounding_box_diagonal, centred
from .result import BoolArray, FloatArray, IntArray, ReferenceGrouping, as_rows, length
from .rigid import Pose, apply, determines_rotation, in_data, kabsch

SAMPLE_SIZE = 3
BLOCK = 256
DEGENERATE = 1e-9
ZERO_LENGTH = 1e-12


def ransac(
    source: ArrayLike,
    target: ArrayLike,
    *,
    resolution: float | None = None,
    tolerance: float | None = None,
    iterations: int = 10_000,
    seed: int = 0,
    refine: bool = False,
    edge_ratio: float | None = None,
    confidence: float | None = None,
) -> ReferenceGrouping:
    p_raw, q_raw = as_rows(source, 3), as_rows(target, 3)
    p, q, n = centred(p_raw), centred(q_raw), len(p_raw)
    d_ransac = length(tolerance, resolution, 5.0)
    best_count, spent = 0, 0
    if n >= SAMPLE_SIZE:
        for first in range(0, iterations, BLOCK):
            triples = sample_triples(n, first, min(BLOCK, iterations - first), seed)
            rotation, translation = kabsch(p[triples], q[triples])
            errors = np.linalg.norm(apply(rotation, translation, p) - q, axis=2)
            counts = (errors < d_ransac).sum(axis=1)  # c = #{i : |T p_i - p'_i| < d}
            counts[degenerate(triples, p) | degenerate(triples, q)] = 0
            if edge_ratio is not None:
                counts[~edges_agree(triples, p, q, edge_ratio)] = 0
            leader = int(np.argmax(counts))
            if counts[leader] > best_count:  # ties keep the earliest iteration
                best_count = int(counts[leader])
                best = rotation[leader], translation[leader]
            spent = first + len(triples)
            if confidence is not None and enough(spent, best_count / n, confidence):
                break

    details = {"iterations": spent, "best_count": best_count}
    if best_count == 0:
        return ReferenceGrouping(np.zeros(n, dtype=bool), None, None, {**details, "transform": None})
    rotation, translation = best  # T*
    mask = np.linalg.norm(apply(rotation, translation, p) - q, axis=1) < d_ransac
    if refine and mask.sum() >= SAMPLE_SIZE and determines_rotation(p[mask], q[mask]):
        rotation, translation = kabsch(p[mask], q[mask])
        mask = np.linalg.norm(apply(rotation, translation, p) - q, axis=1) < d_ransac
    transform = in_data(Pose(rotation, translation), p_raw, q_raw) if mask.any() else None
    return ReferenceGrouping(mask, None, None, {**details, "transform": transform})


def draw(n: int, words: tuple[int, int, int]) -> tuple[int, int, int]:
    """Three distinct indices below n from three 64-bit words."""
    w0, w1, w2 = words
    a = (w0 * n) >> 64
    b = (w1 * (n - 1)) >> 64
    b += b >= a
    c = (w2 * (n - 2)) >> 64
    for taken in sorted((a, b)):
        c += c >= taken
    return a, b, c


def sample_triples(n: int, first: int, count: int, seed: int) -> IntArray:
    """(count,3) samples of the iterations first, first + 1, ..."""
    # Consecutive counters are consecutive blocks of four words of one stream.
    stream = np.random.Philox(counter=first, key=seed).random_raw(4 * count)
    triples = [draw(n, (w0, w1, w2)) for w0, w1, w2, _ in stream.reshape(-1, 4).tolist()]
    return np.array(triples, dtype=np.int64).reshape(-1, SAMPLE_SIZE)


def triple_edges(triples: IntArray, points: FloatArray) -> FloatArray:
    """(count,3) lengths of the edges ab, bc, ca of each sampled triangle."""
    corners = points[triples]
    return np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)


def degenerate(triples: IntArray, points: FloatArray) -> BoolArray:
    """(count,) True for triangles that are too short or too thin to fix a rotation."""
    zero = ZERO_LENGTH * bounding_box_diagonal(points)
    a, b, c = (points[triples[:, corner]] for corner in range(SAMPLE_SIZE))
    twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    edges = triple_edges(triples, points)
    shortest, longest = edges.min(axis=1), edges.max(axis=1)
    is_thin = (shortest <= DEGENERATE * longest) | (twice_area <= DEGENERATE * longest**2)
    return is_thin | (longest <= zero)


def edges_agree(triples: IntArray, source: FloatArray, target: FloatArray, edge_ratio: float) -> BoolArray:
    """(count,) True where min(ds/dt, dt/ds) >= edge_ratio on all three edges."""
    ds, dt = triple_edges(triples, source), triple_edges(triples, target)
    with np.errstate(divide="ignore", invalid="ignore"):
        return (np.minimum(ds / dt, dt / ds) >= edge_ratio).all(axis=1)


def enough(spent: int, inlier_ratio: float, confidence: float) -> bool:
    """Return True when `spent` samples found an all-inlier one with `confidence`."""
    if spent % BLOCK != 0 or inlier_ratio == 0.0:
        return False
    if inlier_ratio == 1.0:
        return True
    with np.errstate(divide="ignore"):
        needed = np.log(1.0 - confidence) / np.log(1.0 - inlier_ratio**SAMPLE_SIZE)
    return bool(spent >= needed)
