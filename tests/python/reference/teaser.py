"""TEASER++ (Yang, Shi, Carlone, T-RO 2021), with the pruning by cores of ROBIN and KISS-Matcher.

With beta the tolerance, and c = 1:

    scale        s = argmin sum_ij min((s - dt_ij / ds_ij)^2 / (2 beta / ds_ij)^2, 1)
    i ~ j        |s ds_ij - dt_ij| < 2 beta, not both edges of zero length
    kept         a maximum clique, or the vertices of the greatest core number
    rotation     GNC-TLS on a_k = s (p_k+1 - p_k), b_k = q_k+1 - q_k over the kept in a ring, bound 2 beta
    translation  per axis argmin sum_k min((t - (q_k - s R p_k))^2 / beta^2, 1)
    group        those kept with |s R p + t - q| <= beta along each axis

Decisions where the source is open
----------------------------------
* Both sides are centred on the mean of all points first.
* GNC: costs in units of (2 beta)^2; it ends where the cost changes by less than 1e-6 of that. Without a measurement of weight
  0.5 at least there is no group, nor where the weighted ones are along one line (dof 6).
* Adaptive voting: the candidates are the weighted means of the sets that hold between two ends of intervals, an end included.
  Costs that differ by less than 1e-9 are the same, and the lowest such set is taken. (The published code adds the
  range of an outlier where the paper has the constant 1.)
* Fewer than three kept, or three on one line unless dof is 4, are no group.
* dof = 4 is a rotation about z; residuals of the rotation are those of x and y.
* Ratios of pairs (i, i + k mod n) for k = 1, ..., n // 2, or where those are more than a million, for 10^6 // n
  values of k spread evenly.
"""

import numpy as np
from numpy.typing import ArrayLike

from .maximum_clique import cores, maximum_clique
from .pairwise import bounding_box_diagonal, centred, distance_difference, edge_lengths
from .result import BoolArray, FloatArray, IntArray, ReferenceGrouping, as_rows, length
from .rigid import Pose, in_data, nearest_rotation, spreads

MOST_RATIOS = 1_000_000
SAME_COST = 1e-9
LINE = 1e-9


def teaser(
    source: ArrayLike,
    target: ArrayLike,
    *,
    resolution: float | None = None,
    tolerance: float | None = None,
    max_distance_difference: float | None = None,
    prune: str = "clique",
    dof: int = 6,
    scale: str = "known",
    max_steps: int = 1_000_000,
) -> ReferenceGrouping:
    p_raw, q_raw = as_rows(source, 3), as_rows(target, 3)
    beta = length(tolerance, resolution, 2.5)
    difference = 2.0 * beta if max_distance_difference is None else max_distance_difference
    nothing = ReferenceGrouping(np.zeros(len(p_raw), dtype=bool), None, None)
    p, q = centred(p_raw), centred(q_raw)
    factor = truncated_scale(p, q, 2.0 * beta) if scale == "estimate" else 1.0
    if factor is None:
        return nothing
    p *= factor
    kept = keep(joined_pairs(p, q, difference), prune, max_steps)
    pose = pose_of(p[kept], q[kept], beta, dof)
    if pose is None:
        return nothing
    rotation, shift = pose
    mask = np.zeros(len(p), dtype=bool)
    mask[kept] = (np.abs(q[kept] - p[kept] @ rotation.T - shift) <= beta).all(axis=1)
    model = in_data(Pose(factor * rotation, shift), p_raw, q_raw)
    return ReferenceGrouping(mask, None, None, {"transform": model})


def joined_pairs(p: FloatArray, q: FloatArray, difference: float) -> BoolArray:
    """(n,n) which pairs keep their distance, equal correspondences aside."""
    return (distance_difference(p, q) < difference) & (edge_lengths(p) + edge_lengths(q) > 0.0)


def keep(joined: BoolArray, prune: str, max_steps: int) -> IntArray:
    if prune == "clique":
        return np.array(maximum_clique(joined, max_steps), dtype=np.int64)
    numbers, _ = cores(joined)
    return np.flatnonzero(numbers == numbers.max(initial=0))


def pose_of(p: FloatArray, q: FloatArray, beta: float, dof: int) -> tuple[FloatArray, FloatArray] | None:
    if len(p) < 3 or (dof == 6 and not all(spreads(x) for x in (p, q))):
        return None
    rotation = truncated_rotation(np.roll(p, -1, axis=0) - p, np.roll(q, -1, axis=0) - q, 2.0 * beta, dof)
    if rotation is None:
        return None
    moved = q - p @ rotation.T
    shift = [truncated_mean(moved[:, axis], np.full(len(p), beta)) for axis in range(3)]
    return rotation, np.array(shift)


def truncated_rotation(a: FloatArray, b: FloatArray, bound: float, dof: int) -> FloatArray | None:
    """Graduated non-convexity on truncated least squares."""
    weights = np.ones(len(a))
    rotation, mu, cost = np.eye(3), 0.0, np.inf
    for step in range(100):
        covariance = (a * weights[:, None]).T @ b
        spread = np.linalg.svd(covariance, compute_uv=False)
        if dof == 6 and not spread[1] > LINE * spread[0]:
            return None
        rotation = least_squares(covariance, dof)
        residuals = (b - a @ rotation.T)[:, : 3 if dof == 6 else 2]
        squares = (residuals**2).sum(axis=1) / bound**2
        if step == 0:
            with np.errstate(divide="ignore"):
                mu = 1.0 / (2.0 * squares.max() - 1.0)
            if mu <= 0.0:
                return rotation
        before, cost = cost, float(weights @ squares)
        with np.errstate(divide="ignore"):
            between = np.sqrt(mu * (mu + 1.0) / squares) - mu
        weights = np.where(
            squares >= (mu + 1.0) / mu, 0.0, np.where(squares <= mu / (mu + 1.0), 1.0, between)
        )
        mu *= 1.4
        if abs(before - cost) < 1e-6:
            break
    return rotation if (weights >= 0.5).any() else None


def least_squares(covariance: FloatArray, dof: int) -> FloatArray:
    """R that minimises sum w |b - R a|^2, of sum w a b'."""
    if dof == 4:
        angle = np.arctan2(covariance[0, 1] - covariance[1, 0], covariance[0, 0] + covariance[1, 1])
        c, s = np.cos(angle), np.sin(angle)
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return nearest_rotation(covariance)


def truncated_mean(values: FloatArray, ranges: FloatArray) -> float:
    """Minimise the sum of min((x - x_k)^2 / r_k^2, 1) by adaptive voting."""
    low, high, weights = values - ranges, values + ranges, ranges**-2.0
    ends = np.unique(np.concatenate([low, high]))
    best, found = np.inf, 0.0
    for place in np.stack([ends, np.append((ends[1:] + ends[:-1]) / 2.0, ends[-1])], axis=1).ravel():
        held = (low <= place) & (place <= high)
        if not held.any():
            continue
        mean = np.average(values[held], weights=weights[held])
        cost = float(weights[held] @ (values[held] - mean) ** 2) - np.count_nonzero(held)
        if cost < best - SAME_COST:
            best, found = cost, float(mean)
    return found


def truncated_scale(p: FloatArray, q: FloatArray, bound: float) -> float | None:
    """Return the scale by adaptive voting on the ratios of edges; None without an edge."""
    n = len(p)
    half, most = n // 2, max(1, MOST_RATIOS // max(n, 1))
    count = min(half, most)
    offsets = [1 + m * half // count for m in range(count)]
    pairs = [(i, (i + k) % n) for k in offsets for i in range(k if 2 * k == n else n)]
    i, j = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    ds, dt = (np.linalg.norm(x[i] - x[j], axis=1) for x in (p, q))
    apart = ds > 1e-12 * bounding_box_diagonal(p)
    if not apart.any():
        return None
    factor = truncated_mean(dt[apart] / ds[apart], bound / ds[apart])
    return factor if factor > 0.0 else None
