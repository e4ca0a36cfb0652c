"""LC: likelihood consensus by position (not of the paper).

With u = tolerance / 3, which is 1 pr by default, p_i and q_i the points of match i:

    L_i   = ln(s n / D_i) + clip(8 (0.87 - rho_i), -0.8, 3),  s = max(1/100, 10/n)
    D_i   = max over both sides of sum_k max(0, 1 - d_ik^2 / (5 u)^2)
    i ~ j : |ds_ij - dt_ij| < 3 u and min(ds_ij, dt_ij) > 6 u
    score = sum over r_i < 6 u of max(0, L_i - r_i^2 / (2 sigma^2)),  sigma = 2.7 u

The heaviest 1,000 edges i ~ j, those with the most common neighbours, each grow to a clique of at most 12: the
candidate that keeps most candidates comes next. The Kabsch motion of a clique is a hypothesis. The best hypothesis
is refined by 4 rounds of weighted least squares, its supporters (r_i < 6 u) are taken out, the next one is the best
of what is left, up to `modes`. Then each is refined by 10 rounds among all matches with sigma from 1.6 times that
down to it.

Decisions where the description is open
---------------------------------------
* Edges are ranked by (common neighbours descending, i, j); an edge without any is none. Of the common neighbours
  of an edge the 256 of the lowest index are candidates; ties in growing go to the lowest index.
* A clique that was grown before is skipped, and so is one on a line on either side: its second singular value is
  at most 1e-7 of the first.
* Weights are posteriors 1 / (1 + e^-(L - r^2 / (2 sigma^2))) of residuals below 3 sigma; refinement ends where those
  lie on a line or are fewer than three.
* A mode needs three supporters with a positive term. Modes are in order of their score among all matches; one that
  lays the source points within 3 u (root mean square) of a better one's is dropped.
* The group has r_i <= 5 u under the best mode; the scores are the posteriors under it, 0 without any mode.
* Of more than 2,500 matches only the 2,500 with the most others such that |ds_ij - dt_ij| < 3 u are joined, ties to
  the lower index.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from .pairwise import centred, distance_difference, edge_lengths
from .result import BoolArray, FloatArray, IntArray, ReferenceGrouping, as_points, as_vector, length
from .rigid import apply, homogeneous

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

EDGES = 1000
VERTICES = 2500
MEMBERS = 12
CANDIDATES = 256
SIGMA = 2.7
FIRST_ROUNDS = [SIGMA] * 4
LAST_ROUNDS = [SIGMA * (1.6 + (1.0 - 1.6) * k / 9) for k in range(10)]
FLAT = 1e-7


class Pose(NamedTuple):
    """R p + t between the centred points."""

    rotation: FloatArray
    translation: FloatArray


class Model(NamedTuple):
    """Centred points in units of u, and the levels L."""

    p: FloatArray
    q: FloatArray
    level: FloatArray

    def squares(self, pose: Pose) -> FloatArray:
        """r_i^2."""
        return ((apply(pose.rotation, pose.translation, self.p) - self.q) ** 2).sum(axis=1)

    def terms(self, pose: Pose) -> FloatArray:
        """Return what each match adds to the score."""
        squares = self.squares(pose)
        return np.where(squares < 6.0**2, np.maximum(0.0, self.level - squares / (2.0 * SIGMA**2)), 0.0)

    def subset(self, rows: BoolArray) -> Model:
        """Return the given matches alone."""
        return Model(self.p[rows], self.q[rows], self.level[rows])


def lc(
    source: ArrayLike,
    target: ArrayLike,
    *,
    ratio: ArrayLike | None = None,
    resolution: float | None = None,
    tolerance: float | None = None,
    modes: int = 40,
) -> ReferenceGrouping:
    """Group the correspondences near the pose under which they are likeliest."""
    p_raw, q_raw = as_points(source), as_points(target)
    unit = length(tolerance, resolution, 3.0, "tolerance") / 3.0
    n = len(p_raw)
    p, q = centred(p_raw) / unit, centred(q_raw) / unit
    model = Model(p, q, levels(p, q, None if ratio is None else as_vector(ratio)))
    agrees = distance_difference(p, q) < 3.0
    kept = np.sort(np.argsort(-agrees.sum(axis=1), kind="stable")[:VERTICES])
    joined = agrees & (np.minimum(edge_lengths(p), edge_lengths(q)) > 6.0)
    found = [kept[clique] for clique in cliques(joined[np.ix_(kept, kept)])]
    hypotheses = [kabsch(p[c], q[c], np.ones(len(c))) for c in found if fixes(p[c], q[c])]
    poses = finish(peel(hypotheses, model, modes), model)
    mask, scores = np.zeros(n, dtype=bool), np.zeros(n)
    if poses:
        squares = model.squares(poses[0])
        mask, scores = squares <= 5.0**2, posterior(model.level - squares / (2.0 * SIGMA**2))
    return ReferenceGrouping(
        mask,
        scores,
        None,
        {"hypotheses": len(hypotheses)},
        np.array([in_data(pose, p_raw, q_raw, unit) for pose in poses]).reshape(-1, 4, 4),
        np.array([model.terms(pose).sum() for pose in poses]),
    )


def levels(p: FloatArray, q: FloatArray, ratio: FloatArray | None) -> FloatArray:
    """(n,) L_i."""
    n = len(p)
    if n == 0:
        return np.zeros(0)
    density = [np.maximum(0.0, 1.0 - (edge_lengths(x) / 5.0) ** 2).sum(axis=1) for x in (p, q)]
    chance = np.log(max(0.01, 10.0 / n) * n / np.maximum(*density))
    return chance if ratio is None else chance + np.clip(8.0 * (0.87 - ratio), -0.8, 3.0)


def cliques(joined: BoolArray) -> list[IntArray]:
    """Distinct cliques grown from the heaviest edges, in their order; members ascending."""
    edges = heaviest_edges(joined)
    neighbors = joined.astype(np.float32)
    members = [list(edge) for edge in edges]
    left = joined[edges[:, 0]] & joined[edges[:, 1]]
    left &= left.cumsum(axis=1) <= CANDIDATES
    for _ in range(MEMBERS - 2):
        kept = np.where(left, left.astype(np.float32) @ neighbors, -1.0)  # what each candidate keeps
        for row in np.flatnonzero(left.any(axis=1)):
            best = int(kept[row].argmax())
            members[row].append(best)
            left[row] &= joined[best]
    return [np.array(clique) for clique in dict.fromkeys(tuple(sorted(row)) for row in members)]


def heaviest_edges(joined: BoolArray) -> IntArray:
    """(m,2) the edges i < j with the most common neighbours, one at least."""
    single = joined.astype(np.float32)
    common = np.where(np.triu(joined, 1), single @ single, 0.0)
    i, j = np.nonzero(common)
    order = np.argsort(-common[i, j], kind="stable")[:EDGES]
    return np.stack([i[order], j[order]], axis=1)


def fixes(p: FloatArray, q: FloatArray) -> bool:
    """Return True for three points or more that lie on a line on neither side."""
    if len(p) < 3:
        return False
    spread = [np.linalg.svd(x - x.mean(axis=0), compute_uv=False) for x in (p, q)]
    return all(s[1] > FLAT * s[0] for s in spread)


def kabsch(p: FloatArray, q: FloatArray, weight: FloatArray) -> Pose:
    """Weighted least-squares motion."""
    p_mean, q_mean = np.average(p, axis=0, weights=weight), np.average(q, axis=0, weights=weight)
    u, _, vt = np.linalg.svd(((p - p_mean) * weight[:, None]).T @ (q - q_mean))
    turn = np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)])
    rotation = vt.T @ turn @ u.T
    return Pose(rotation, q_mean - rotation @ p_mean)


def posterior(log_odds: FloatArray) -> FloatArray:
    """Probability from the logarithm of the odds."""
    with np.errstate(over="ignore"):
        return 1.0 / (1.0 + np.exp(-log_odds))


def refine(pose: Pose, model: Model, deviations: list[float]) -> Pose:
    """Weighted least squares, one round per deviation."""
    for sigma in deviations:
        squares = model.squares(pose)
        near = squares < (3.0 * sigma) ** 2
        if not fixes(model.p[near], model.q[near]):
            break
        weight = posterior(model.level[near] - squares[near] / (2.0 * sigma**2))
        pose = kabsch(model.p[near], model.q[near], weight)
    return pose


def peel(hypotheses: list[Pose], model: Model, most: int) -> list[Pose]:
    """Refined best hypothesis, that of what is left without its supporters, and so on."""
    scores = np.array([model.terms(pose).sum() for pose in hypotheses])
    found: list[Pose] = []
    while len(found) < most and scores.max(initial=0.0) > 0.0:
        best = int(scores.argmax())
        scores[best] = 0.0
        pose = refine(hypotheses[best], model, FIRST_ROUNDS)
        if np.count_nonzero(model.terms(pose)) < 3:
            continue
        found.append(pose)
        model = model.subset(model.squares(pose) >= 6.0**2)
        alive = np.flatnonzero(scores)
        scores[alive] = [model.terms(hypotheses[k]).sum() for k in alive]
    return found


def finish(poses: list[Pose], model: Model) -> list[Pose]:
    """Refine among all matches; the best first, without what repeats a better one."""
    refined = [refine(pose, model, LAST_ROUNDS) for pose in poses]
    scores = np.array([model.terms(pose).sum() for pose in refined])
    kept: list[Pose] = []
    for k in np.argsort(-scores, kind="stable"):
        pose = refined[k]
        if np.count_nonzero(model.terms(pose)) >= 3 and all(apart(pose, x, model.p) >= 3.0 for x in kept):
            kept.append(pose)
    return kept


def apart(a: Pose, b: Pose, p: FloatArray) -> float:
    """Root mean square distance between where two poses lay the points."""
    difference = apply(a.rotation, a.translation, p) - apply(b.rotation, b.translation, p)
    return float(np.sqrt((difference**2).sum(axis=1).mean()))


def in_data(pose: Pose, p_raw: FloatArray, q_raw: FloatArray, unit: float) -> FloatArray:
    """(4,4) the motion in the caller's coordinates."""
    shift = unit * pose.translation + q_raw.mean(axis=0) - pose.rotation @ p_raw.mean(axis=0)
    return homogeneous(pose.rotation, shift)
