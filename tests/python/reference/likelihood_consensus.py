"""LC: likelihood consensus (not of the paper).

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

The score of a pose is that sum times the share of 1,000 source points (rows floor(k n / 1000)) that it lays within 5 u
of any target; the best wins.

Frames, with R_i = L'_i^T L_i. They agree with a pose if the angle to its rotation is below 30 degrees. pi is the
share of the supporters (r_i <= 5 u), of the poses above with less than 0.01 false alarms, whose frames agree. Where there is
such a pose, frames count if pi >= 3/4; else they are tried with pi = 1/2, and the best pose by position stays if it has
at most 1/100 of the false alarms of the best with frames. With frames

    term  = max(0, L_i + a_i - r_i^2 / (2 sigma^2)) / c_i,  at most pi = 0.9 in a_i:
    a_i   = max(ln(1 - pi), ln(1 - pi + 40 pi) - (1 - cos theta_i) / (10 degrees)^2), theta_i between R and R_i
    c_i   = matches within 15 u of i at both ends with |ds - dt| < 3 u, itself among them

and stars are hypotheses too: j is in the star of i if the angle between R_i and R_j is below 30 degrees, |ds - dt| < 3 u,
both lengths exceed 6 u, and the pose of either one's frames lays the other within 3 u + 2 sin(15 degrees) ds. Of the 300
largest stars the motion of all, and of the centre with each of the first 3 members: least squares of points and frames,
the latter with weight (sigma / 10 degrees)^2. In refinement the frames that say more than ln(1 - pi) draw the pose as well:
it maximises sum w_i (-|R p_i + t - q_i|^2 / (2 sigma^2) - (1 - cos theta_i) / (10 degrees)^2), the second term of these alone.

False alarms of a pose: n^3 / 6 P(Poisson(lambda k' / k) >= k' - 3), k the supporters, k' those left when, by ascending residual,
one is dropped that has a kept one within 7 u on either side (until 200 are kept; k counts those looked at), lambda the mean
number of targets within 5 u of the 1,000 source points as the pose lays them, at least k / n. Infinite where a motion onto the
target mirrored at x = 0 has more than 0.9 times the k' of the best, after 5 rounds of refinement: one that fits the supporters
of one of the ten best poses (not on a line), or, without a tolerance, of the cliques of the 100 heaviest edges the one with the greatest score.
Where more than 0.8 of what is within 5 u under either is so under both, the numbers don't count, and the false alarms are infinite unless the mean
square of these residuals under the best is at most 1.1 + 3 / sqrt(number) times the other (with 1e-6 tolerances squared added to both), and
the second variance of their source points exceeds 4 times it.

Where a known scale leaves 0.001 or more, 11 times the least of n^2 P(Poisson(lambda k' / k) >= k' - 2) over the radii r = 5 u / 2^j, j = 0 .. 10,
counts if it is less, as long as k' >= 4. The pose is refined further by 3 rounds of deviation 0.54 r each; supporters are within r, apart 7 u as before; lambda is the
greatest of: targets of other matches within r of a source point (the mean number less k / n), that of r = 5 u times 4^-j, n times min(1, r / (2 s)) for
the two greatest standard deviations s of the supporters' source points, and n times the squared share of distances in the source that differ by at most r from
one in the target of another pair, two such aside (of 64 points, rows floor(k n / 64)).

Without a tolerance: all of this with u = 1 pr, by position alone. False alarms count 5 times, without a resolution 9 times. Unless
their number is below 1e-4 (or below 0.01 by frames), the same with u twice as large, half, 4 times, a quarter. The 8 best modes of each of these 5
are compared by the mean of their scores with the four least u; the modes of the u that has the best one are reordered by it. Another u with less than 0.01 false alarms
whose best pose moves the points to within 6 u (the greater one; root mean square) of where the best does makes it as sure as it is itself, if that is surer,
and if a reflection that equals the best has at most 0.8 times the k' of the best with that u. Without a resolution
u = 0.8 / 3 of the lesser of both sides' mean distance of nearest points (those that coincide aside), and while the number is not below 0.01, 8 and 16 times that and 1/8 and 1/16
follow; the fewest false alarms win. Then frames count.
Under the best pose, of radii 5 u 2^(k/2), k = -8 .. 8, from k = 0 on the one with the least number of false alarms is sought that
is no greater than that of the 2 next ones on both sides. For each, the pose is refined by 5 rounds, deviation from 1.6 times
0.54 radii down to that; supporters are those within the radius, apart 7/5 radii, k' the share of k that it is of those looked at. That deviation is the noise.

The radius of the group: of the residuals below W = 3.4 sigma the right ones have density r / sigma^2 exp(-r^2 / (2 sigma^2)), the others 2 r / W^2. 12 rounds of
expectation maximization from the share 1/2 (in each, sigma is estimated and the share is (m + 1) / (n + 2), m the sum of the weights, n the number below W) give sigma' and m; the next sigma is the geometric
mean of sigma' with weight m and sigma_0 with weight 30, at most 1.3 times the last or its inverse; 12 times. sigma_0 is 0.8 of the mean distance of nearest points above (of at most 1,000 points); sigma
starts there, or where W holds 6 residuals, and stays within a factor of 3 of it. The radius R = 2 sigma, at least the noise / 0.54 (or 5 pr if less), yields to 5 pr if it is between 0.4 and 2.5 times that, else
to the geometric mean of both, at least the noise / 0.54 where R is greater; R alone where it is less than a quarter. From then on u = R / 5, with the levels of before. The best pose is that of the noise where this is below 2.7 u and the false alarms are below 0.01,
else it is refined from what it was by 6 rounds of 2.7 u.

Unknown scale: all of this with the source times s. With size the median distance of a side from its median along each axis
(of an even number the upper one) and rho = size_q / size_p, s lies between max(low, rho / 3) and min(high, 3 rho). With each tolerance 3 u
the fewest equal parts of the logarithm of that range are taken that are no wider than 1 + clip(3 u / size_q, 0.02, 0.08), and the middle
of each is a scale to try: of the 1,000 matches with the most others such that |ds - dt| < 3 u and of the 20 heaviest edges, the best mode by L
with D of the target alone, refined by 8 rounds of weighted least squares with a factor of s that is free (Umeyama, PAMI 1991). The score is
that under the similarity times the coverage before. Of the scales in order of score the first 3 count that differ from better ones by more
than 2 such parts. Where there are several sure answers with a tolerance, the greatest score wins, else the fewest false alarms; their number is
that of one scale and tolerance times the number of all scales to try with all tolerances. Without a given tolerance, the noise is then
estimated twice as above, the same least squares done with residuals below 3 times it, and all of it done again at that scale. Frames count in the end, at the scale that was found. Without an answer s is the geometric mean of the bounds.

Instances: in order of score the poses with less than 0.01 false alarms among the matches that no earlier one's group
has (the best in any case), whose group shares less than 0.3 (intersection over union) with each of theirs; none unless the best is sure.

Decisions where the description is open
---------------------------------------
* Numbers of false alarms that differ by less than 1e-9 of their size are equal: the radius nearest to the first one, and the
  tolerance or scale that was tried first, are kept.
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

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import logsumexp
from scipy.stats import poisson

from .pairwise import centred, distance_difference, edge_lengths
from .result import BoolArray, FloatArray, IntArray, ReferenceGrouping, as_rows, has_frame
from .rigid import Pose, apply, fixes_rotation, in_data, nearest_rotation, weighted_kabsch

EDGES = 1000
MIRRORED_EDGES = 100
VERTICES = 2500
MEMBERS = 12
CANDIDATES = 256
SIGMA = 2.7
FIRST_ROUNDS = [SIGMA] * 4
LAST_ROUNDS = [SIGMA * (1.6 + (1.0 - 1.6) * k / 9) for k in range(10)]
SAMPLES = 1000
FRAME_SIGMA = np.deg2rad(10.0)
LEAST_SHARE = 0.75
STARS = 300
PAIRS = 3
ENOUGH = 200
TIE = 1e-12
EQUAL_ALARMS = 1e-9
REFLECTIONS = 10
MIRROR = np.array([-1.0, 1.0, 1.0])
MOST_ALARMS = 0.01
CLEAR_ALARMS = 1e-4
COMPARED, CANDIDATE_MODES = 5, 8
RADII = 11
SCALE_VERTICES, SCALE_EDGES, SCALE_ROUNDS, SCALES = 1000, 20, 8, 3
NOISE_ROUNDS = 2


class Model(NamedTuple):
    """Centred points in units of u, the levels L, and the weights and frames of the matches, where these count."""

    p: FloatArray
    q: FloatArray
    level: FloatArray
    weight: FloatArray | None = None
    turns: FloatArray | None = None
    share: float = 0.0

    def squares(self, pose: Pose) -> FloatArray:
        return ((apply(pose.rotation, pose.translation, self.p) - self.q) ** 2).sum(axis=1)

    def levels(self, pose: Pose) -> FloatArray:
        """L_i + a_i."""
        if self.turns is None:
            return self.level
        loss, said = self.said(self.turns, pose)
        return self.level + np.where(np.isfinite(said), np.maximum(loss, said), 0.0)

    def said(self, turns: FloatArray, pose: Pose) -> tuple[float, FloatArray]:
        """What frames say that don't agree with a pose, and what they say if they do; NaN without any."""
        cosine = (np.einsum("nij,ij->n", turns, pose.rotation) - 1.0) / 2.0
        gain = np.log(1.0 - self.share + 40.0 * self.share)
        return float(np.log(1.0 - self.share)), gain - (1.0 - cosine) / FRAME_SIGMA**2

    def drawing(self, pose: Pose, rows: BoolArray, weight: FloatArray) -> FloatArray:
        """Weighted sum of the rotations of frames that say more for the pose than wrong ones do."""
        if self.turns is None:
            return np.zeros((3, 3))
        loss, said = self.said(self.turns[rows], pose)
        return (weight[said > loss, None, None] * self.turns[rows][said > loss]).sum(axis=0)

    def log_odds(self, pose: Pose) -> FloatArray:
        return self.levels(pose) - self.squares(pose) / (2.0 * SIGMA**2)

    def positive(self, pose: Pose) -> BoolArray:
        return (self.squares(pose) < 6.0**2) & (self.log_odds(pose) > 0.0)

    def terms(self, pose: Pose) -> FloatArray:
        """Return what each match adds to the support."""
        terms = np.where(self.positive(pose), self.log_odds(pose), 0.0)
        return terms if self.weight is None else self.weight * terms

    def subset(self, rows: BoolArray) -> "Model":
        weight = None if self.weight is None else self.weight[rows]
        turns = None if self.turns is None else self.turns[rows]
        return Model(self.p[rows], self.q[rows], self.level[rows], weight, turns, self.share)


class Ranked(NamedTuple):
    """A mode, its score, and how many targets are near where it lays a source point, in the mean."""

    pose: Pose
    score: float
    chance: float


Answer = tuple[Model, list[Ranked]]
"""What the modes are of, and they, the best first."""


def lc(
    source: ArrayLike,
    target: ArrayLike,
    *,
    ratio: ArrayLike | None = None,
    source_lrf: ArrayLike | None = None,
    target_lrf: ArrayLike | None = None,
    resolution: float | None = None,
    tolerance: float | None = None,
    modes: int = 40,
    instances: int = 1,
    scale: bool | tuple[float, float] = False,
) -> ReferenceGrouping:
    p_raw, q_raw = as_rows(source, 3), as_rows(target, 3)
    turns = proposed(len(p_raw), source_lrf, target_lrf)
    rows = None if ratio is None else as_rows(ratio)

    def look(length: float, factor: float) -> Attempt:
        edges = 0 if tolerance else MIRRORED_EDGES
        return attempt(factor * p_raw, q_raw, rows, length / 3.0, modes, edges, rigid=scale is False)

    span = span_of_scales(p_raw, q_raw, scale)
    factor = 1.0 if span is None else float(np.sqrt(span.low * span.high))
    lengths = [tolerance] if tolerance is not None else tolerances(factor * p_raw, q_raw, resolution)
    if span is None:
        tried = len(lengths)
        found = at_known_scale(look, lengths, told=resolution is not None, turns=turns, modes=modes)
    else:
        tried = sum(len(span.parts(length)[0]) for length in lengths)
        likely = {length: likely_scales(p_raw, q_raw, rows, span, length) for length in lengths}
        found, factor = at_likely_scale(look, likely, span, tried, told=resolution is not None)
        found = count_frames(found, turns, modes)
    noise = None
    if tolerance is None and found.ranked:
        likely = likely_tolerance(factor * p_raw, q_raw, SAMPLES)
        found, noise = adapted(found, resolution, likely, tried)
    false_alarms = found.expected * tried
    to_data = np.diag([factor, factor, factor, 1.0])
    model, counted, ranked = found.model, found.counted, found.ranked
    mask, scores = np.zeros(len(p_raw), dtype=bool), np.zeros(len(p_raw))
    if ranked:
        best = ranked[0].pose
        mask, scores = model.squares(best) <= 5.0**2, posterior(counted.log_odds(best))
    ok = bool(false_alarms < MOST_ALARMS)
    return ReferenceGrouping(
        mask,
        scores,
        None,
        {"hypotheses": len(found.hypotheses), "resolution": found.unit, "scale": factor},
        np.array([in_data(one.pose, factor * p_raw, q_raw, found.unit) @ to_data for one in ranked]).reshape(
            -1, 4, 4
        ),
        np.array([one.score for one in ranked]),
        ok=ok,
        false_alarms=float(false_alarms),
        noise=noise,
        instances=find_instances(model, ranked, instances if ok else 0) if instances > 1 else None,
    )


def tolerances(p: FloatArray, q: FloatArray, resolution: float | None) -> list[float]:
    """Return the tolerances to try, the likeliest first."""
    if resolution is not None:
        first, reach = 3.0 * resolution, 2
    else:
        first, reach = likely_tolerance(p, q), 4
    return [first * 2.0**k for k in sorted(range(-reach, reach + 1), key=lambda k: (abs(k), -k))]


def likely_tolerance(p: FloatArray, q: FloatArray, most: int | None = None) -> float:
    length = 0.8 * min(spacing(p, most), spacing(q, most))
    return length if np.isfinite(length) else 1.0


def spacing(points: FloatArray, most: int | None = None) -> float:
    """Mean distance of points (at most some) from their nearest other one, of those that have one elsewhere."""
    lengths = edge_lengths(points)
    np.fill_diagonal(lengths, np.inf)
    count = min(len(points), most or len(points))
    nearest = lengths.min(axis=1, initial=np.inf)[np.arange(count) * len(points) // max(1, count)]
    nearest = nearest[(nearest > 0) & np.isfinite(nearest)]
    return float(nearest.mean()) if nearest.size else np.inf


class Attempt(NamedTuple):
    """What was found with one tolerance: the matches without frames and as they count, and what they say."""

    unit: float
    model: Model
    counted: Model
    ranked: list[Ranked]
    expected: float
    kept: IntArray
    mirrored: list[IntArray]
    hypotheses: list[Pose]
    rigid: bool
    image: Pose | None

    def is_better(self, found: "tuple[Attempt, float] | None", tried: int) -> bool:
        if found is None:
            return self.expected < np.inf
        other = found[0]
        if max(self.expected, other.expected) * tried < MOST_ALARMS:
            return self.ranked[0].score > other.ranked[0].score
        return is_fewer(self.expected, other.expected)


Look = Callable[[float, float], Attempt]
"""Of a tolerance and a scale, what is found with them."""


class Span(NamedTuple):
    """Bounds of the scale, and the target's size."""

    low: float
    high: float
    size: float

    def parts(self, tolerance: float) -> tuple[FloatArray, float]:
        """Return the scales to try, and the logarithm of the step that they aim at."""
        step = float(np.log(1.0 + np.clip(tolerance / self.size, 0.02, 0.08)))
        width = np.log(self.high / self.low)
        count = max(1, int(np.ceil(width / step)))
        return self.low * np.exp(width * (np.arange(count) + 0.5) / count), step


def span_of_scales(p: FloatArray, q: FloatArray, scale: bool | tuple[float, float]) -> Span | None:
    """None where the scale is known, for fewer than three points, or where those of a side coincide."""
    if scale is False or len(p) < 3:
        return None
    sizes = [size_of(x) for x in (p, q)]
    diagonals = [float(np.linalg.norm(np.ptp(x, axis=0))) for x in (p, q)]
    if any(size <= 1e-12 * length for size, length in zip(sizes, diagonals, strict=True)):
        return None
    low, high = (0.0, np.inf) if scale is True else scale
    rho = sizes[1] / sizes[0]
    return Span(max(low, rho / 3.0), min(high, 3.0 * rho), sizes[1])


def size_of(points: FloatArray) -> float:
    def median(values: FloatArray) -> float:
        return float(np.sort(values)[len(values) // 2])

    middle = [median(axis) for axis in points.T]
    return median(np.linalg.norm(points - middle, axis=1))


def likely_scales(
    p_raw: FloatArray, q_raw: FloatArray, ratio: FloatArray | None, span: Span, tolerance: float
) -> list[float]:
    """Return the likeliest scales, the best first."""
    unit = tolerance / 3.0
    q = centred(q_raw) / unit
    level = levels(q, q, ratio)
    tried, step = span.parts(tolerance)
    found: list[tuple[float, float]] = []
    for scale in tried:
        p = centred(scale * p_raw) / unit
        kept, joined = join(p, q, SCALE_VERTICES)
        model = Model(p, q, level)
        ranked = rank(model, motions(p, q, [kept[clique] for clique in cliques(joined, SCALE_EDGES)]), 1)
        if ranked:
            factor, pose = with_scale(ranked[0].pose, model)
            score = float(model.terms(pose).sum()) * landing(model, ranked[0].pose, 5.0)[0]
            found.append((score, float(np.clip(scale * factor, span.low, span.high))))
    chosen: list[float] = []
    for score, scale in sorted(found, key=lambda one: -one[0]):
        if score > 0.0 and len(chosen) < SCALES and all(abs(np.log(scale / x)) > 2 * step for x in chosen):
            chosen.append(scale)
    return chosen


def with_scale(pose: Pose, model: Model, deviation: float = SIGMA) -> tuple[float, Pose]:
    """Refine a pose with a factor of the source, which the rotation is multiplied by."""
    factor = 1.0
    for _ in range(SCALE_ROUNDS):
        squares = model.squares(pose)
        near = squares < (3.0 * deviation) ** 2
        p, q = model.p[near], model.q[near]
        if not fixes_rotation(p, q):
            break
        weight = posterior(model.level[near] - squares[near] / (2.0 * SIGMA**2))
        rotation = weighted_kabsch(p, q, weight).rotation
        p_mean, q_mean = (np.average(x, axis=0, weights=weight) for x in (p, q))
        turned = (p - p_mean) @ rotation.T
        factor = float((weight @ (turned * (q - q_mean))).sum() / (weight @ turned**2).sum())
        pose = Pose(factor * rotation, q_mean - factor * rotation @ p_mean)
    return factor, pose


def join(p: FloatArray, q: FloatArray, most: int) -> tuple[IntArray, BoolArray]:
    """Return which matches are joined at most, and which of them are."""
    agrees = distance_difference(p, q) < 3.0
    kept = np.sort(np.argsort(-agrees.sum(axis=1), kind="stable")[:most])
    joined = agrees & (np.minimum(edge_lengths(p), edge_lengths(q)) > 6.0)
    return kept, joined[np.ix_(kept, kept)]


def motions(p: FloatArray, q: FloatArray, found: list[IntArray]) -> list[Pose]:
    return [weighted_kabsch(p[c], q[c], np.ones(len(c))) for c in found if fixes_rotation(p[c], q[c])]


def at_known_scale(look: Look, lengths: list[float], *, told: bool, turns: FloatArray, modes: int) -> Attempt:
    """Return what is found with the likeliest tolerance, or another one."""
    tried = len(lengths)
    first = look(lengths[0], 1.0)
    framed = count_frames(first, turns, modes)
    if tried == 1 or first.expected * tried < CLEAR_ALARMS:
        return framed
    if framed.counted.turns is not None and framed.expected * tried < MOST_ALARMS:
        return framed
    attempts = [first, *(look(length, 1.0) for length in lengths[1:COMPARED])]
    winner, scores = best_of(attempts)
    order = np.argsort(-scores, kind="stable")
    found = attempts[winner]
    found = found._replace(ranked=[found.ranked[k]._replace(score=float(scores[k])) for k in order])
    found = with_expected(found)
    for other in attempts:
        sure = other is not attempts[winner] and other.expected * tried < MOST_ALARMS
        surer = sure and is_near(found, other) and is_fewer(other.expected, found.expected)
        if surer and not is_doubted(found, other):
            found = found._replace(expected=other.expected)
    for length in [] if told else lengths[COMPARED:]:
        if found.expected * tried < MOST_ALARMS:
            break
        other = look(length, 1.0)
        if is_fewer(other.expected, found.expected):
            found = other
    return count_frames(found, turns, modes)


def best_of(attempts: list[Attempt]) -> tuple[int, FloatArray]:
    """Return which one has the best mode, and the mean scores of its modes."""
    means = [mean_scores(attempts, of) for of in attempts]
    best = [of[:CANDIDATE_MODES].max(initial=-np.inf) for of in means]
    return int(np.argmax(best)), means[int(np.argmax(best))]


def mean_scores(attempts: list[Attempt], of: Attempt) -> FloatArray:
    """Mean scores of an attempt's modes with the tolerances of all, but for the greatest."""
    scores = np.zeros((len(attempts), len(of.ranked)))
    for k, other in enumerate(attempts):
        for j, one in enumerate(of.ranked):
            pose = Pose(one.pose.rotation, one.pose.translation * of.unit / other.unit)
            scores[k, j] = other.model.terms(pose).sum() * landing(other.model, pose, 5.0)[0]
    counted = [other.unit <= 2.0 * attempts[0].unit for other in attempts]
    return np.asarray(scores[counted].mean(axis=0))


def at_likely_scale(
    look: Look, likely: dict[float, list[float]], span: Span, tried: int, *, told: bool
) -> tuple[Attempt, float]:
    """Return what is found at the likeliest scale, and that; `likely` are the scales to try with each tolerance."""
    best: tuple[Attempt, float] | None = None
    first, *others = likely
    for length, scales in likely.items():
        for factor in scales:
            other = look(length, factor)
            sure = other.expected * tried < MOST_ALARMS
            if (length == first or sure or not told) and other.is_better(best, tried):
                best = other, factor
        if best is not None and best[0].expected * tried < MOST_ALARMS:
            break
    middle = float(np.sqrt(span.low * span.high))
    found, factor = best or (look(first, middle), middle)  # nothing that is no chance
    for _ in range(NOISE_ROUNDS if others else 0):
        if found.ranked:
            pose, deviation = refined_by_noise(found.model, found.ranked[0].pose)
            factor *= with_scale(pose, found.model, deviation)[0]
            factor = float(np.clip(factor, span.low, span.high))
            found = look(3.0 * found.unit, factor)
    return found, factor


def attempt(
    p_raw: FloatArray,
    q_raw: FloatArray,
    ratio: FloatArray | None,
    unit: float,
    modes: int,
    mirrored_edges: int,
    *,
    rigid: bool,
) -> Attempt:
    p, q = centred(p_raw) / unit, centred(q_raw) / unit
    kept, joined = join(p, q, VERTICES)
    hypotheses = motions(p, q, [kept[clique] for clique in cliques(joined, EDGES)])
    mirrored = [kept[clique] for clique in cliques(joined, mirrored_edges)]
    return judge(p, q, ratio, unit, modes, hypotheses, kept, mirrored, rigid=rigid)


def judge(
    p: FloatArray,
    q: FloatArray,
    ratio: FloatArray | None,
    unit: float,
    modes: int,
    hypotheses: list[Pose],
    kept: IntArray,
    mirrored: list[IntArray],
    *,
    rigid: bool,
) -> Attempt:
    model = Model(p, q, levels(p, q, ratio))
    ranked = rank(model, hypotheses, modes)
    found = Attempt(unit, model, model, ranked, np.inf, kept, mirrored, hypotheses, rigid, None)
    return with_expected(found)


def with_expected(found: Attempt) -> Attempt:
    """Return what was found with its number of false alarms, and a reflection that equals it."""
    image = equal_reflection(found) if found.ranked else None
    number = np.inf
    if found.ranked and image is None:
        number = alarms(found.model, found.ranked[0], np.zeros(len(found.model.p), dtype=bool))
        if found.rigid and number >= MOST_ALARMS / 10.0:
            number = min(number, precise_alarms(found.model, found.ranked[0].pose))
    return found._replace(expected=number, image=image)


def is_doubted(found: Attempt, other: Attempt) -> bool:
    """Whether a reflection that equals the best pose has nearly as many supporters with another tolerance."""
    if found.image is None:
        return False
    factor = found.unit / other.unit
    pose, image = (
        Pose(one.rotation, one.translation * factor) for one in (found.ranked[0].pose, found.image)
    )
    own = other.model.squares(pose)
    return reflected(other.model, image)[0] / max(supporters_apart(other.model, own), 1) > 0.8


def count_frames(found: Attempt, turns: FloatArray, modes: int) -> Attempt:
    """Return what was found with frames, where they count."""
    if not np.isfinite(turns).any():
        return found
    answer = found.model, found.ranked
    counted, ranked = with_frames(answer, turns, found.hypotheses, found.kept, modes)
    if counted.turns is None:
        return found
    return with_expected(found._replace(counted=counted, ranked=ranked))


def adapted(found: Attempt, resolution: float | None, likely: float, tried: int) -> tuple[Attempt, float]:
    """Return what was found in units of the group's radius, its best pose refined, and the noise."""
    pose = found.ranked[0].pose
    exact, deviation = refined_by_noise(found.counted, pose)
    noise = deviation * found.unit
    residuals = found.unit * np.sqrt(found.counted.squares(pose))
    unit = group_radius(residuals, resolution, likely, noise) / 5.0
    factor = found.unit / unit

    def scaled(pose: Pose) -> Pose:
        return Pose(pose.rotation, pose.translation * factor)

    model, counted = (x._replace(p=x.p * factor, q=x.q * factor) for x in (found.model, found.counted))
    if noise < (1.0 - EQUAL_ALARMS) * SIGMA * unit and found.expected * tried < MOST_ALARMS:
        best = scaled(exact)
    else:
        best = refine(scaled(pose), counted, [SIGMA] * 6)
    poses = [best, *(scaled(one.pose) for one in found.ranked[1:])]
    ranked = [
        Ranked(pose, one.score, landing(model, pose, 5.0)[1])
        for pose, one in zip(poses, found.ranked, strict=True)
    ]
    return found._replace(unit=unit, model=model, counted=counted, ranked=ranked), noise


def group_radius(residuals: FloatArray, resolution: float | None, likely: float, noise: float) -> float:
    """Return the radius of the group that the residuals suggest, or that of the resolution."""
    prior = likely
    ordered = np.sort(residuals)
    sigma = max(prior, ordered[min(6, len(ordered)) - 1] / 3.4)
    for _ in range(12):
        window = 3.4 * sigma
        near = ordered[ordered < window]
        own, share, count = sigma, 0.5, 0.0
        for _ in range(12):
            right = share * window**2 / (2.0 * own**2) * np.exp(-(near**2) / (2.0 * own**2))
            weight = right / (right + 1.0 - share)
            count = float(weight.sum())
            if not (weight * near**2).sum() > 0.0:
                count = 0.0
                break
            share = (count + 1.0) / (len(near) + 2.0)
            own = float(np.sqrt((weight * near**2).sum() / (2.0 * count)))
        if count == 0.0:
            break
        mean = np.exp((count * np.log(own) + 30.0 * np.log(prior)) / (count + 30.0))
        sigma = float(np.clip(mean, sigma / 1.3, sigma * 1.3))
    least = noise / 0.54 if resolution is None else min(noise / 0.54, 5.0 * resolution)
    radius = max(2.0 * float(np.clip(sigma, prior / 3.0, 3.0 * prior)), least)
    if resolution is None:
        return radius
    given = 5.0 * resolution
    if 0.4 < radius / given < 2.5:
        return given
    if radius > given:
        return max(float(np.sqrt(given * radius)), noise / 0.54)
    return float(np.sqrt(given * radius)) if radius > 0.25 * given else radius


def is_near(found: Attempt, other: Attempt) -> bool:
    """Return True where both have the same motion first, or the former has none."""
    if not found.ranked or not other.ranked:
        return not found.ranked
    a, b = found.ranked[0].pose, other.ranked[0].pose
    laid = found.unit * apply(a.rotation, a.translation, found.model.p)
    laid -= other.unit * apply(b.rotation, b.translation, other.model.p)
    return bool(np.sqrt((laid**2).sum(axis=1).mean()) < 6.0 * max(found.unit, other.unit))


def refined_by_noise(model: Model, pose: Pose) -> tuple[Pose, float]:
    """Return the pose refined by the noise under it, and that."""
    tried: dict[int, tuple[float, Pose]] = {}
    best = 0
    while steps := [k for k in range(best - 2, best + 3) if abs(k) <= 8 and k not in tried]:
        for step in steps:
            radius = 5.0 * 2.0 ** (step / 2)
            fitted = refine(pose, model, [0.54 * radius * (1.6 - 0.6 * k / 4) for k in range(5)])
            squares = model.squares(fitted)
            rows = np.flatnonzero(squares <= radius**2)
            kept, looked = independent(model.p, model.q, squares, rows, 1.4 * radius)
            share = kept / max(1, looked)
            chance = max(landing(model, fitted, radius)[1], len(rows) / len(squares)) * share
            least = max(0, int(np.floor(share * len(rows) + 0.5)) - 3)
            tail = 0.0 if least <= chance else logsumexp(poisson.logpmf(least + np.arange(300), chance))
            tried[step] = 3.0 * np.log(len(squares)) - np.log(6.0) + tail, fitted
        best = min(tried, key=lambda k: (np.round(tried[k][0] / EQUAL_ALARMS), abs(k)))
    return tried[best][1], 2.7 * 2.0 ** (best / 2)


def landing(model: Model, pose: Pose, radius: float) -> tuple[float, float]:
    """Share of 1,000 source points that the pose lays within a radius of any target, and how many are, in the mean."""
    n = len(model.p)
    rows = np.arange(min(n, SAMPLES)) * n // max(1, min(n, SAMPLES))
    moved = apply(pose.rotation, pose.translation, model.p[rows])
    near = (((moved[:, None] - model.q) ** 2).sum(axis=2) < radius**2).sum(axis=1)
    return float(np.mean(near > 0)), float(near.mean())


def proposed(n: int, source_lrf: ArrayLike | None, target_lrf: ArrayLike | None) -> FloatArray:
    """(n,3,3) the rotations that frames propose, NaN for none."""
    if source_lrf is None or target_lrf is None:
        return np.full((n, 3, 3), np.nan)
    source, target = as_rows(source_lrf, 3, 3), as_rows(target_lrf, 3, 3)
    turns = target.transpose(0, 2, 1) @ source
    turns[~has_frame(source, target)] = np.nan
    return turns


def rank(model: Model, hypotheses: list[Pose], modes: int) -> list[Ranked]:
    found: list[Ranked] = []
    for pose in finish(peel(hypotheses, model, modes), model):
        covered, near = landing(model, pose, 5.0)
        found.append(Ranked(pose, float(model.terms(pose).sum() * covered), near))
    return sorted(found, key=lambda one: -one.score)


def with_frames(
    answer: Answer, turns: FloatArray, cliques: list[Pose], vertices: IntArray, modes: int
) -> Answer:
    """Return the answer with frames, where they count."""
    model, ranked = answer
    nothing = np.zeros(len(turns), dtype=bool)
    agree: list[BoolArray] = []
    for one in ranked:
        if alarms(model, one, nothing) < MOST_ALARMS:
            group = (model.squares(one.pose) <= 5.0**2) & np.isfinite(turns[:, 0, 0])
            agree.append(agreeing(turns[group], one.pose.rotation))
    agrees = np.concatenate(agree) if agree else np.zeros(0)
    if agrees.size and agrees.mean() < LEAST_SHARE:
        return answer
    share = min(float(agrees.mean()), 0.9) if agrees.size else 0.5
    framed = model._replace(weight=1.0 / cluster_sizes(model.p, model.q), turns=turns, share=share)
    after = rank(framed, cliques + stars(model.p, model.q, turns, vertices), modes)
    if not agrees.size and ranked:
        before = alarms(model, ranked[0], nothing)
        if not after or 100.0 * before <= alarms(model, after[0], nothing):
            return answer
    return framed, after


def agreeing(turns: FloatArray, rotation: FloatArray) -> BoolArray:
    return np.einsum("nij,ij->n", turns, rotation) > 1.0 + 2.0 * np.cos(np.pi / 6.0)


def cluster_sizes(p: FloatArray, q: FloatArray) -> FloatArray:
    """(n,) c_i."""
    ds, dt = edge_lengths(p), edge_lengths(q)
    return ((ds < 15.0) & (dt < 15.0) & (np.abs(ds - dt) < 3.0)).sum(axis=1).astype(np.float64)


def stars(p: FloatArray, q: FloatArray, turns: FloatArray, vertices: IntArray) -> list[Pose]:
    """Motions of the largest stars, each followed by those of its pairs."""
    p, q, turns = p[vertices], q[vertices], turns[vertices]
    ds, dt = edge_lengths(p), edge_lengths(q)
    a, b = p[None] - p[:, None], q[None] - q[:, None]  # [i, j] from i to j
    laid = np.linalg.norm(np.einsum("iab,ijb->ija", turns, a) - b, axis=2)  # by the frames of i
    reach = 3.0 + 2.0 * np.sin(np.pi / 12.0) * ds
    joined = (np.einsum("iab,jab->ij", turns, turns) > 1.0 + 2.0 * np.cos(np.pi / 6.0)) & (laid < reach)
    joined &= (reach > laid.T) & (np.abs(ds - dt) < 3.0) & (np.minimum(ds, dt) > 6.0)
    poses: list[Pose] = []
    for i in np.argsort(-joined.sum(axis=1), kind="stable")[:STARS]:
        members = np.flatnonzero(joined[i])
        if len(members):
            sets = [np.concatenate([[i], members]), *(np.array([i, j]) for j in members[:PAIRS])]
            drawn = (SIGMA / FRAME_SIGMA) ** 2
            poses += [
                fit_posed(p[rows], q[rows], np.ones(len(rows)), drawn * turns[rows].sum(axis=0))
                for rows in sets
            ]
    return poses


def fit_posed(p: FloatArray, q: FloatArray, weight: FloatArray, turns: FloatArray) -> Pose:
    """Least squares of points, and of frames given as the weighted sum of the rotations they propose."""
    p_mean, q_mean = np.average(p, axis=0, weights=weight), np.average(q, axis=0, weights=weight)
    rotation = nearest_rotation(((p - p_mean) * weight[:, None]).T @ (q - q_mean) + turns.T)
    return Pose(rotation, q_mean - rotation @ p_mean)


def independent(
    p: FloatArray, q: FloatArray, squares: FloatArray, rows: IntArray, apart: float = 7.0
) -> tuple[int, int]:
    """Number of supporters that lie apart, and of those looked at."""
    kept: list[int] = []
    looked = 0
    for i in rows[np.argsort(np.round(squares[rows] / (TIE * apart**2)), kind="stable")]:
        looked += 1
        if all(((x[i] - x[kept]) ** 2).sum(axis=1).min(initial=np.inf) > apart**2 for x in (p, q)):
            kept.append(int(i))
            if len(kept) == ENOUGH:
                break
    return len(kept), looked


def alarms(model: Model, one: Ranked, taken: BoolArray) -> float:
    """Number of false alarms among the matches that are not taken."""
    squares = model.squares(one.pose)
    n = int(np.count_nonzero(~taken))
    supporters = np.flatnonzero((squares <= 5.0**2) & ~taken)
    kept, looked = independent(model.p, model.q, squares, supporters)
    chance = max(one.chance, len(supporters) / max(1, n)) * kept / max(1, looked)
    least = max(0, kept - 3)
    tail = 1.0 if least <= chance else float(poisson.sf(least - 1, chance))
    return n**3 / 6.0 * tail


def is_fewer(one: float, other: float) -> bool:
    return one < (1.0 - EQUAL_ALARMS) * other


def equal_reflection(found: Attempt) -> Pose | None:
    """Return a motion onto the mirrored target that has about as many supporters as the best pose, elsewhere."""
    model = found.model
    mirrored = model._replace(q=model.q * MIRROR)
    p, q = mirrored.p, mirrored.q
    starts: list[Pose] = []
    for one in found.ranked[:REFLECTIONS]:
        rows = model.squares(one.pose) <= 5.0**2
        if fixes_rotation(p[rows], q[rows]):
            starts.append(weighted_kabsch(p[rows], q[rows], np.ones(np.count_nonzero(rows))))
    starts += sorted(motions(p, q, found.mirrored), key=lambda pose: -mirrored.terms(pose).sum())[:1]
    best = model.squares(found.ranked[0].pose)
    own = supporters_apart(model, best)
    for start in starts:
        count, squares = reflected(model, start)
        same = is_same(p, best, squares)
        if count / max(own, 1) > 0.9 if same is None else not same:
            return start
    return None


def reflected(model: Model, start: Pose) -> tuple[int, FloatArray]:
    """Return the number of supporters apart of a refined motion onto the mirrored target, and squared residuals."""
    mirrored = model._replace(q=model.q * MIRROR)
    squares = mirrored.squares(refine(start, mirrored, [SIGMA] * 5))
    return supporters_apart(mirrored, squares), squares


def supporters_apart(model: Model, squares: FloatArray) -> int:
    return independent(model.p, model.q, squares, np.flatnonzero(squares <= 5.0**2))[0]


def is_same(p: FloatArray, own: FloatArray, image: FloatArray) -> bool | None:
    """Whether a reflection that has the supporters of a pose fits no better and these are not on a line; None for others."""
    common = (own <= 5.0**2) & (image <= 5.0**2)
    count = np.count_nonzero(common)
    if count <= 0.8 * np.count_nonzero((own <= 5.0**2) | (image <= 5.0**2)):
        return None
    means = [squares[common].mean() + (3e-6) ** 2 for squares in (own, image)]
    return bool(
        means[0] <= (1.1 + 3.0 / np.sqrt(count)) * means[1] and variances(p[common])[1] > 4.0 * means[0]
    )


def variances(p: FloatArray) -> FloatArray:
    """(3,) along the principal axes, the greatest first."""
    return np.linalg.eigvalsh(np.cov(p.T, bias=True))[::-1]


def precise_alarms(model: Model, pose: Pose) -> float:
    """Number of false alarms within smaller radii."""
    n = len(model.p)
    rows = np.arange(min(n, 64)) * n // min(n, 64)
    a, b = np.triu_indices(len(rows), 1)
    starts, ends = (edge_lengths(x[rows])[a, b] for x in (model.p, model.q))
    least, crowd = np.inf, 0.0
    for k in range(RADII):
        radius = 5.0 / 2.0**k
        pose = refine(pose, model, [0.54 * radius] * 3)
        squares = model.squares(pose)
        supporters = np.flatnonzero(squares <= radius**2)
        kept, looked = independent(model.p, model.q, squares, supporters)
        if kept < 4:
            break
        near = landing(model, pose, radius)[1] - len(supporters) / n
        crowd = near if k == 0 else crowd
        with np.errstate(divide="ignore", invalid="ignore"):
            widths = 2.0 * np.sqrt(np.maximum(variances(model.p[supporters])[:2], 0.0))
            area = np.minimum(1.0, radius / widths).prod()
        agree = np.abs(starts[:, None] - ends) <= radius
        np.fill_diagonal(agree, False)  # a pair with itself
        share = max(0, agree.sum() - 2) / max(1, len(starts) * (len(starts) - 1))
        chance = max(near, crowd / 4.0**k, n * area, n * share**2) * kept / looked
        tail = 1.0 if kept - 2 <= chance else float(poisson.sf(kept - 3, chance))
        least = min(least, n**2 * tail)
    return RADII * least


def find_instances(model: Model, ranked: list[Ranked], most: int) -> BoolArray:
    """(m,n) groups of the poses that are sure by what earlier ones leave."""
    n = len(model.p)
    masks: list[BoolArray] = []
    taken = np.zeros(n, dtype=bool)
    for one in ranked:
        if len(masks) == most:
            break
        mask = model.squares(one.pose) <= 5.0**2
        new = all(np.count_nonzero(mask & x) < 0.3 * np.count_nonzero(mask | x) for x in masks)
        if new and (not masks or alarms(model, one, taken) < MOST_ALARMS):
            masks.append(mask)
            taken |= mask
    return np.array(masks, dtype=bool).reshape(len(masks), n)


def levels(p: FloatArray, q: FloatArray, ratio: FloatArray | None) -> FloatArray:
    """(n,) L_i."""
    n = len(p)
    if n == 0:
        return np.zeros(0)
    density = [np.maximum(0.0, 1.0 - (edge_lengths(x) / 5.0) ** 2).sum(axis=1) for x in (p, q)]
    chance = np.log(max(0.01, 10.0 / n) * n / np.maximum(*density))
    return chance if ratio is None else chance + np.clip(8.0 * (0.87 - ratio), -0.8, 3.0)


def cliques(joined: BoolArray, most: int) -> list[IntArray]:
    """Distinct cliques grown from the heaviest edges, in their order; members ascending."""
    edges = heaviest_edges(joined)[:most]
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


def posterior(log_odds: FloatArray) -> FloatArray:
    with np.errstate(over="ignore"):
        return 1.0 / (1.0 + np.exp(-log_odds))


def refine(pose: Pose, model: Model, deviations: list[float]) -> Pose:
    """Weighted least squares, one round per deviation."""
    for sigma in deviations:
        squares = model.squares(pose)
        near = squares < (3.0 * sigma) ** 2
        if not fixes_rotation(model.p[near], model.q[near]):
            break
        weight = posterior(model.levels(pose)[near] - squares[near] / (2.0 * sigma**2))
        weight *= 1.0 if model.weight is None else model.weight[near]
        turns = (sigma / FRAME_SIGMA) ** 2 / 2.0 * model.drawing(pose, near, weight)
        pose = fit_posed(model.p[near], model.q[near], weight, turns)
    return pose


def peel(hypotheses: list[Pose], model: Model, most: int) -> list[Pose]:
    """Refined best hypothesis, that of what is left without its supporters, and so on."""
    scores = np.array([model.terms(pose).sum() for pose in hypotheses])
    found: list[Pose] = []
    while len(found) < most and scores.max(initial=0.0) > 0.0:
        best = int(scores.argmax())
        scores[best] = 0.0
        pose = refine(hypotheses[best], model, FIRST_ROUNDS)
        if np.count_nonzero(model.positive(pose)) < 3:
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
        if np.count_nonzero(model.positive(pose)) >= 3 and all(apart(pose, x, model.p) >= 3.0 for x in kept):
            kept.append(pose)
    return kept


def apart(a: Pose, b: Pose, p: FloatArray) -> float:
    """Root mean square distance between where two poses lay the points."""
    difference = apply(a.rotation, a.translation, p) - apply(b.rotation, b.translation, p)
    return float(np.sqrt((difference**2).sum(axis=1).mean()))
