"""Probabilities of matches, several motions, and the bound on rivals (not of the paper).

With lengths in u, the resolution, or a third of 0.8 times the lesser of both sides' mean distance of nearest points (1/3 if
all coincide), p_i and q_i the points of match i, motions k = 1 .. m of poses T_k, shares pi_k and variances s_k:

    f_ik     = pi_k (2 pi s_k)^(-3/2) exp(-|T_k p_i - q_i|^2 / (2 s_k))
    f_i0     = (1 - sum pi_k) D_i / (n V),  D_i = sum_j max(0, 1 - |q_i - q_j|^2 / 25),  V = 8 pi 125 / 15
    w_ik     = f_ik / (f_i0 + sum_k f_ik)
    T_k      = weighted least squares by w_ik > 0.001, where poses are fitted and these fix a rotation
    pi_k     = (sum_i w_ik + 1/2) / (n + (m + 1) / 2)
    s_k      = (sum_i w_ik |T_k p_i - q_i|^2 + 30 1.6^2) / (3 (sum_i w_ik + 10))

Probabilities: 30 iterations for one motion from s = 1.6^2 and pi = max(size, 3) / (n + 1); its pose is the model, or else that of the mask,
fitted. w_i1 is multiplied by 1 / (1 + exp(f / 3) + sum_r exp((f - f_r) / 3)). f is ln 2 plus the lesser of ln(false alarms)
within 5 and within 3 sqrt(s) (if less than 5), at least 5 where the group's false alarms are infinite; f_r that within 5 of
the alternatives 1 .. 7 that move the members by more than 10 (root mean square). False alarms are those of LC,
supporters 7 apart. Without a pose, or for fewer than three matches, all are 0.

Motions: LC of the matches, then of those that its group leaves, and so on while it is ok. One that moves its members within 6
of where an earlier one moves them is none. u is a third of the first tolerance. From s = 1.6^2 and pi as above, divided by
max(1, their sum) (1 + 1/n), ten iterations with fitted poses. Match i belongs to the k of the greatest w_ik if
|T_k p_i - q_i| <= 5. The last motion that moves its matches within 6 of where an earlier one moves them, or has less than
half of its members while its false alarms within 5, among the matches of no other, are 0.01 or more, is dropped, and all is repeated with the others as LC found them.

Bound: what a clique of |ds - dt| <= 2 e has at most if it has at most half of the matches laid by the pose within e.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp
from scipy.stats import poisson

from .likelihood_consensus import independent, lc, spacing
from .pairwise import edge_lengths
from .result import BoolArray, FloatArray, ReferenceGrouping
from .rigid import Pose, fixes_rotation, weighted_kabsch

PRIOR = 1.6**2
FITTED = 1e-3


class Motion(NamedTuple):
    """A pose in units of u, with share and variance."""

    pose: Pose
    share: float
    variance: float


def squares(pose: Pose, p: FloatArray, q: FloatArray) -> FloatArray:
    return ((p @ pose.rotation.T + pose.translation - q) ** 2).sum(axis=1)


def weights(motions: list[Motion], p: FloatArray, q: FloatArray) -> FloatArray:
    """(n,m) the probability that each match belongs to each motion."""
    density = np.maximum(0.0, 1.0 - edge_lengths(q) ** 2 / 25.0).sum(axis=1)
    wrong = (1.0 - sum(one.share for one in motions)) * density / (len(q) * 8.0 * np.pi * 125.0 / 15.0)
    logs = [np.log(wrong)]
    for pose, share, variance in motions:
        logs.append(np.log(share) - 1.5 * np.log(2 * np.pi * variance) - squares(pose, p, q) / (2 * variance))
    logs = np.stack(logs, axis=1)
    return np.exp(logs - logsumexp(logs, axis=1, keepdims=True))[:, 1:]


def improve(motions: list[Motion], p: FloatArray, q: FloatArray, *, fits: bool) -> list[Motion]:
    found = []
    for (pose, _, _), weight in zip(motions, weights(motions, p, q).T, strict=True):
        rows = weight > FITTED
        is_fitted = fits and fixes_rotation(p[rows], q[rows])
        fitted = weighted_kabsch(p[rows], q[rows], weight[rows]) if is_fitted else pose
        total = weight.sum()
        share = (total + 0.5) / (len(p) + (len(motions) + 1) / 2)
        variance = (weight @ squares(fitted, p, q) + 30.0 * PRIOR) / (3.0 * (total + 10.0))
        found.append(Motion(fitted, share, variance))
    return found


def log_alarms(pose: Pose, p: FloatArray, q: FloatArray, radius: float, taken: BoolArray) -> float:
    off = squares(pose, p, q)
    rows = np.flatnonzero((off <= radius**2) & ~taken)
    n = len(p) - int(taken.sum())
    kept, looked = independent(p, q, off, rows, 7.0)
    samples = p[np.arange(min(len(p), 1000)) * len(p) // min(len(p), 1000)]
    moved = samples @ pose.rotation.T + pose.translation
    near = float((((moved[:, None] - q) ** 2).sum(axis=2) < radius**2).sum(axis=1).mean())
    chance, least = max(near, len(rows) / n) * kept / max(1, looked), max(0, kept - 3)
    tail = 0.0 if least <= chance else logsumexp(poisson.logpmf(least + np.arange(500), chance))
    return float(np.clip(3.0 * np.log(n) - np.log(6.0) + tail, -3000.0, 3000.0))


def posed(matrix: FloatArray, scale: float, unit: float) -> Pose:
    return Pose(matrix[:3, :3] / scale, matrix[:3, 3] / unit)


def match_probabilities(
    source: FloatArray,
    target: FloatArray,
    mask: BoolArray,
    model: FloatArray | None,
    alternatives: FloatArray | None = None,
    false_alarms: float | None = None,
    resolution: float | None = None,
) -> FloatArray:
    n, scale = len(source), 1.0
    if model is not None:
        scale = float(np.cbrt(np.linalg.det(model[:3, :3])))
    unit = resolution
    if unit is None:
        least = min(spacing(scale * source), spacing(target)) if n > 1 else np.inf
        unit = 0.8 * least / 3.0 if np.isfinite(least) else 1.0 / 3.0
    p, q = scale * source / unit, target / unit
    if n < 3 or (model is None and not fixes_rotation(p[mask], q[mask])):
        return np.zeros(n)
    start = (
        weighted_kabsch(p[mask], q[mask], np.ones(mask.sum())) if model is None else posed(model, scale, unit)
    )
    motions = [Motion(start, max(mask.sum(), 3) / (n + 1), PRIOR)]
    for _ in range(30):
        motions = improve(motions, p, q, fits=model is None)
    pose, _, variance = motions[0]
    none, radius = np.zeros(n, dtype=bool), 3.0 * np.sqrt(variance)
    own = log_alarms(pose, p, q, 5.0, none)
    if radius < 5.0:
        own = min(own, log_alarms(pose, p, q, radius, none))
    own += np.log(2.0)
    if false_alarms == np.inf:
        own = max(own, 5.0)
    odds = 1.0 + np.exp(own / 3.0)
    for matrix in [] if alternatives is None else alternatives[1:8]:
        rival = posed(matrix, scale, unit)
        apart = (p @ (rival.rotation - pose.rotation).T + rival.translation - pose.translation)[mask]
        if np.sqrt((apart**2).sum() / max(1, mask.sum())) > 10.0:
            odds += np.exp((own - log_alarms(rival, p, q, 5.0, none)) / 3.0)
    return weights(motions, p, q)[:, 0] / odds


def group_motions(
    source: FloatArray, target: FloatArray, resolution: float, most: int = 20
) -> list[ReferenceGrouping]:
    """Groups of matches with a known resolution; `alternatives` has the pose."""
    p, q = source / resolution, target / resolution
    left, found = np.arange(len(p)), []
    while len(found) < most:
        one = lc(source[left], target[left], resolution=resolution)
        if not one.ok or one.alternatives is None:
            break
        rows, left = left[one.mask], left[~one.mask]
        pose = posed(one.alternatives[0], 1.0, resolution)
        moved = [p[rows] @ other.rotation.T + other.translation for other, _, _ in found]
        here = p[rows] @ pose.rotation.T + pose.translation
        if not any(np.sqrt(((there - here) ** 2).sum(axis=1).mean()) < 6.0 for there in moved):
            found.append((pose, len(rows), one.false_alarms))
    return share_out(p, q, found, resolution) if found else []


def share_out(
    p: FloatArray, q: FloatArray, found: list[tuple[Pose, int, float | None]], unit: float
) -> list[ReferenceGrouping]:
    n = len(p)
    shares = np.array([max(size, 3) / (n + 1) for _, size, _ in found])
    shares /= max(1.0, shares.sum()) * (1.0 + 1.0 / n)
    motions = [Motion(pose, share, PRIOR) for (pose, _, _), share in zip(found, shares, strict=True)]
    for _ in range(10):
        motions = improve(motions, p, q, fits=True)
    scores = weights(motions, p, q)
    off = np.stack([squares(one.pose, p, q) for one in motions], axis=1)
    owner = scores.argmax(axis=1)
    owner[off[np.arange(n), owner] > 25.0] = -1
    for k in reversed(range(len(found))):
        taken = (owner >= 0) & (owner != k)
        size = (owner == k).sum()
        moved = [p[owner == k] @ one.pose.rotation.T + one.pose.translation for one in motions[: k + 1]]
        off_by = [((moved[-1] - there) ** 2).sum() / max(1, size) for there in moved[:-1]]
        is_same, is_lost = any(np.sqrt(square) < 6.0 for square in off_by), 2 * size < found[k][1]
        if is_same or (
            is_lost and (size == 0 or log_alarms(motions[k].pose, p, q, 5.0, taken) >= np.log(0.01))
        ):
            return share_out(p, q, found[:k] + found[k + 1 :], unit) if len(found) > 1 else []
    groups = []
    for k, (pose, _, variance) in enumerate(motions):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = pose.rotation, unit * pose.translation
        noise = float(np.sqrt(variance) * unit)
        groups.append(
            ReferenceGrouping(
                owner == k, scores[:, k], None, {}, matrix[None], noise=noise, false_alarms=found[k][2]
            )
        )
    return groups


def largest_rival(
    source: FloatArray, target: FloatArray, model: FloatArray, tolerance: float
) -> tuple[int, int]:
    """Return the number of matches laid, and the size of the largest clique with at most half of them."""
    laid = np.linalg.norm(source @ model[:3, :3].T + model[:3, 3] - target, axis=1) <= tolerance
    joined = np.abs(edge_lengths(source) - edge_lengths(target)) <= 2.0 * tolerance
    half, best = int(laid.sum()) // 2, 0
    stack: list[tuple[list[int], int]] = [([], 0)]
    while stack:
        clique, first = stack.pop()
        best = max(best, len(clique))
        stack.extend(
            ([*clique, i], i + 1)
            for i in range(first, len(source))
            if joined[i, clique].all() and laid[[*clique, i]].sum() <= half
        )
    return int(laid.sum()), best
