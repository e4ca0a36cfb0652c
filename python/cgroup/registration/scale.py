"""Register clouds of unknown scale: likely scales, a search at each, the best.

Descriptors of voxels of two sizes are alike where the ratio of the sizes is the scale. Matches that agree on
one scale, as in TEASER++ (Yang, Shi, Carlone, T-RO 2021), then tell it closer; the surfaces tell it closest.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup import _core, features
from cgroup._checks.arrays import in_double
from cgroup._checks.run_options import run_options
from cgroup._runtime.progress import ignore_progress
from cgroup.errors import InputError
from cgroup.features import Cloud
from cgroup.features.voxels import choose_thinning
from cgroup.registration.judge import (
    MOST_OPEN_MOTIONS,
    are_alternatives,
    bound_by_motions,
    is_accepted,
    judge,
    share_probability,
    weigh,
)
from cgroup.registration.matching import scale_matches
from cgroup.registration.motions import OPEN, motion
from cgroup.registration.prepare import DenseFront, Given, Preparation, PreparedScan, agree
from cgroup.registration.result import registration_of
from cgroup.registration.scan import ViewDirection
from cgroup.rigid import apply, cross_products, scaling, split_scale

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cgroup.registration.judge import Case, Found, Judgement
    from cgroup.registration.result import Registration
    from cgroup.registration.search import Search
    from cgroup.types import FloatArray

WITHIN = 3.0
"""Factor around the ratio of the clouds' sizes within which the scale is sought."""

VOXELS, SIZES, STEP = 2500, 4, 2**0.5
"""Voxels of the finest size at which a cloud is described, how many sizes there are, and their ratio."""

MATCHES, AGREE, APART = 400, 1.0, 4.0
"""Best matches of two sizes; voxels by which two of them may disagree, and must lie apart."""

GRID, AROUND = 2 ** (1 / 16), 4
"""Ratio of the scales that are tried, and how many to either side of a ratio of sizes."""

CANDIDATES, AS_LIKELY = 2, 0.7
"""Scales at which a pose is searched for, and their consensus at the least, as a share of the greatest."""

BEND, UNCERTAIN = 6.0, 0.01
"""Edge of the cells whose mean residuals tell of bends, in voxels; deviation of the scale that is noted."""

DRIFT, CLEARLY, NOTED, SOME = 0.01, 3.0, 0.8, 3
"""Deviation of the scale of right poses; deviations at which half of a probability is left, and the share of
these from which that is noted; one voxel of so many is looked at."""

_POWER_STEPS = 8
_REACH, _LAST_REACH, _REACHED = 3.0, 1.5, 5  # voxels, and the step from which the reach stays
_STEPS, _STILL, _LEAST_PAIRS = 30, 1e-3, 50
_CUT, _PER_MEDIAN, _LEAST_DEVIATION, _DAMPING = 4.685, 1.4826, 1e-3, 1e-6  # as for `align`


class Candidate(NamedTuple):
    """A rigid pose of the source times a scale, and what speaks for it."""

    scale: float
    pose: FloatArray
    case: Case


def register_scaled(
    search: Search,
    given: tuple[Given, Given],
    voxel: float | None,
    front: DenseFront | None,
    bounds: tuple[float, float],
) -> tuple[Registration | None, Judgement]:
    """Search for the similarity of two scans, and judge it."""
    for one in given:
        if one.is_ready:
            raise InputError(one.name, "a PreparedScan, whose scale is fixed", "give the cloud itself")
    begin, threads = search.clock.start, search.threads
    radii = DenseFront() if front is None else front
    by_frames = any(one.by_frames for one in given)
    begin("scale")
    sources, targets = (_describe_sizes(one, radii, threads, by_frames=by_frames) for one in given)
    low, high = _narrow(bounds, targets[0].voxel / sources[0].voxel)
    scales = _find_scales(sources, targets, low, high, threads)
    shared = Preparation(targets[0].voxel, radii, threads)
    target = shared.finish(given[1], begin, by_frames=by_frames)
    found, source = list[Candidate](), target
    for scale in scales:
        source = shared.finish(_scaled(given[0], scale), begin, by_frames=by_frames)
        rough = replace(search, effort="low").run(source, target)
        begin("scale")
        fitted = None if rough is None else fit_similarity(source, target, rough.refined.T_target_source)
        if rough is not None and fitted is not None:
            clipped = float(np.clip(scale * fitted.scale, low, high))
            found.append(Candidate(clipped, fitted.pose, rough.cases[0]))
    if not found:
        return None, judge(None, source, target, search.axis, scaled=True)
    found.sort(key=lambda candidate: -weigh(candidate.case))
    best = found[0]
    agreed = agree((_scaled(given[0], best.scale), given[1]), voxel, front, threads)
    how = {"by_frames": by_frames, "with_descriptors": False}
    source = agreed.finish(_scaled(given[0], best.scale), begin, **how)
    target = agreed.finish(given[1], begin, **how)
    begin("scale")
    fitted = fit_similarity(source, target, best.pose) or Similarity(1.0, best.pose, 0.0, np.inf)
    scale = float(np.clip(best.scale * fitted.scale, low, high))
    source = agreed.finish(_scaled(given[0], scale), begin, by_frames=by_frames)
    placed = replace(search, proposed=fitted.pose[None]).run(source, target)
    if placed is None:
        return None, judge(None, source, target, search.axis, scaled=True)
    is_open = fitted.resistance <= OPEN
    placed = _weigh_scales(placed, scale, found, len(scales), is_open=is_open)
    judgement = judge(placed, source, target, search.axis, scaled=True)
    deviation = min(fitted.deviation, float(np.log(high / low)))
    if is_open:
        reason = "the surfaces leave the scale free, as a corner does: give clouds that show more"
        judgement = replace(judgement, reason=reason)
    elif deviation > UNCERTAIN:
        why = "the surfaces fit as bent ones do, or show little of it"
        note = f"the scale is known to {100 * deviation:.1f} % only: {why}"
        judgement = replace(judgement, notes=(*judgement.notes, note))
    done = registration_of(placed, judgement, search.clock.stop())
    return _unscaled(done, scale, deviation), judgement


def _narrow(bounds: tuple[float, float], ratio: float) -> tuple[float, float]:
    """Return the bounds of the scale, narrowed by the ratio of the clouds' sizes."""
    low, high = max(bounds[0], ratio / WITHIN), min(bounds[1], ratio * WITHIN)
    if low > high:
        near = f"the clouds' sizes speak for {ratio:.3g}, within a factor of {WITHIN:g}"
        raise InputError("scale", f"({bounds[0]:g}, {bounds[1]:g})", f"{near}: give bounds around that")
    return low, high


class _Described(NamedTuple):
    """Voxels of one size that have descriptors."""

    voxel: float
    points: FloatArray
    descriptors: NDArray[np.float32]


def _describe_sizes(
    given: Given, radii: DenseFront, threads: int | None, *, by_frames: bool
) -> list[_Described]:
    """Describe a scan at voxels of several sizes, as far as they leave a surface."""
    scan = given.whole
    eye = None if given.viewpoint is None else scan.viewpoint(given.viewpoint)
    finest = choose_thinning(scan.cloud, voxels=VOXELS, threads=threads)
    found: list[_Described] = []
    for size in finest * STEP ** np.arange(SIZES):
        shared = Preparation(float(size), radii, threads)
        try:
            voxels = shared.thin(scan, ignore_progress)
            thinned = Cloud(voxels.points, name=scan.name)
            parts = scan, voxels, thinned, eye, ignore_progress
            normals, _ = shared.orient(*parts, by_frames=by_frames, role="")
        except InputError:
            if not found:
                raise
            break
        values = shared.describe_by_fpfh(thinned, normals)
        rows = np.isfinite(values).all(axis=1) & values.any(axis=1)
        found.append(_Described(float(size), voxels.points[rows], values[rows]))
    return found


def _find_scales(
    sources: list[_Described], targets: list[_Described], low: float, high: float, threads: int | None
) -> list[float]:
    """Return the likeliest scales."""
    pairs = [(source, target) for source in sources for target in targets]
    finest = [pair for pair in pairs if pair[0] is sources[0] or pair[1] is targets[0]]
    votes: list[tuple[float, float]] = []
    for source, target in finest:
        ratio = target.voxel / source.voxel
        factors = GRID ** np.arange(-AROUND, AROUND + 1.0)
        factors = factors[(ratio * factors >= low) & (ratio * factors <= high)]
        if len(factors):
            consensus = _measure_consensus(source, target, factors, threads)
            votes += zip((ratio * factors).tolist(), consensus, strict=True)
    chosen: list[float] = []
    votes.sort(key=lambda vote: -vote[1])
    for scale, consensus in votes:
        if len(chosen) == CANDIDATES or consensus < AS_LIKELY * votes[0][1]:
            break
        if all(abs(np.log(scale / other)) > 1.99 * np.log(GRID) for other in chosen):
            chosen.append(scale)
    return chosen or [float(np.sqrt(low * high))]


def _measure_consensus(
    source: _Described, target: _Described, factors: FloatArray, threads: int | None
) -> list[float]:
    """Return the greatest eigenvalue of the graph of matches that agree in pairs, for each scale.

    Two agree where their distances do: ``|dt - f ds| < 1``, in voxels of the source and of the target. The
    eigenvalue is about the size of the largest clique (M. Leordeanu and M. Hebert, *A spectral technique for
    correspondence problems using pairwise constraints*, ICCV 2005).
    """
    matches = features.match(source.descriptors, target.descriptors, mutual=True, threads=threads)
    best = np.argsort(matches.ratio, kind="stable")[:MATCHES]
    ds = _distances(source.points[matches.source_indices[best]] / source.voxel)
    dt = _distances(target.points[matches.target_indices[best]] / target.voxel)
    apart = (ds >= APART) & (dt >= APART)
    found: list[float] = []
    for factor in factors:
        agree = ((np.abs(dt - factor * ds) < AGREE) & apart).astype(np.float32)
        vector, value = np.ones(len(best), np.float32), 0.0
        for _ in range(_POWER_STEPS):
            vector = agree @ vector
            value = float(np.linalg.norm(vector))
            vector /= max(value, 1.0)
        found.append(value)
    return found


def _distances(points: FloatArray) -> FloatArray:
    centered = points - points.mean(axis=0) if len(points) else points
    squares = (centered**2).sum(axis=1)
    return np.sqrt(np.maximum(squares[:, None] + squares - 2 * centered @ centered.T, 0))


class Similarity(NamedTuple):
    """A rigid pose of the source times a scale.

    Attributes
    ----------
    scale : float
        Of the source as it was given: near 1.
    pose : (4,4) array of float64
        Of the scaled source.
    resistance : float
        How much the surfaces resist scaling while all motions are free, as a share of that of all pairs.
    deviation : float
        Standard deviation of the scale, as a share of it.
    """

    scale: float
    pose: FloatArray
    resistance: float
    deviation: float


def compare_scales(found: Found) -> Found:
    """Return a pose with the scale that fits clearly better, if one does, and a lower probability then.

    Of an accepted pose half of the probability is left where the scale is `CLEARLY` deviations from 1. Those
    are of the fit, and of `DRIFT`: fragments of one room fit best at scales a little off 1.
    """
    if not is_accepted(found.probability):
        return found
    fitted = fit_similarity(found.source, found.target, found.refined.T_target_source, every=SOME)
    if fitted is None or fitted.resistance <= OPEN:
        return found
    away = abs(float(np.log(fitted.scale))) / float(np.hypot(fitted.deviation, DRIFT)) / CLEARLY
    better = fitted.scale if away >= NOTED else 1.0
    return replace(found, better_scale=better, probability=found.probability * 0.5**away**4)


def fit_similarity(
    source: PreparedScan, target: PreparedScan, pose: FloatArray, every: int = 1
) -> Similarity | None:
    """Fit scale and pose to the voxels of both; None where too few are near each other.

    Point-to-plane steps in both directions, weighted as for `align`; the seventh unknown is the logarithm of
    the scale, about the middle of the pairs. Its deviation takes the means of the residuals in cells of
    `BEND` voxels for errors that all pull the scale one way, as those of bent surfaces may. Of either scan
    one voxel of so many is laid on the other.
    """
    voxel, transform, options = source.voxel, pose, run_options(source.threads)
    fixed, step = target.voxels.points, 0
    sources, targets = source.normals[::every], target.normals[::every]
    while True:
        share = min(step / _REACHED, 1.0)
        reach = voxel * (_REACH + (_LAST_REACH - _REACH) * share)
        moved = apply(transform, source.voxels.points)
        offsets = np.concatenate(
            [
                -_core.nearest(moved[::every].copy(), fixed, options, reach),
                _core.nearest(fixed[::every].copy(), moved, options, reach),
            ]
        )
        places = np.concatenate([moved[::every], fixed[::every] + offsets[len(sources) :]])
        normals = np.concatenate([sources @ split_scale(transform)[1][:3, :3].T, targets])
        paired = np.isfinite(offsets).all(axis=1) & np.isfinite(normals).all(axis=1)
        if paired.sum() < _LEAST_PAIRS:
            return None
        places, offsets, normals = places[paired], offsets[paired], normals[paired]
        middle = np.median(places, axis=0)
        arms = places - middle
        radius = np.median(np.linalg.norm(arms, axis=1))
        residuals = np.einsum("ij,ij->i", normals, offsets)
        # Most of a prism fits wherever it slides: the residuals of its ends count until the reach stays.
        least = max(_LEAST_DEVIATION * voxel, (1 - share) * reach)
        deviation = max(_PER_MEDIAN * float(np.median(np.abs(residuals))), least)
        weights = np.maximum(1 - (offsets**2).sum(axis=1) / reach**2, 0)
        weights *= np.maximum(1 - (residuals / (_CUT * deviation)) ** 2, 0) ** 2
        outwards = np.einsum("ij,ij->i", normals, arms)[:, None]
        rows = np.concatenate([cross_products(arms, normals) / radius, normals, outwards / radius], axis=1)
        matrix = rows.T @ (weights[:, None] * rows)
        damped = matrix + _DAMPING * matrix.diagonal().max() * np.eye(7)
        change = -np.linalg.solve(damped, rows.T @ (weights * residuals))
        turned = motion(np.append(change[:3] / radius, change[3:6]), middle)
        transform = turned @ scaling(float(np.exp(change[6] / radius)), middle) @ transform
        resisted = 1.0 / (np.linalg.inv(damped)[6, 6] * max(weights.sum(), 1e-300))
        step += 1
        if step == _STEPS or (step > _REACHED and np.abs(change).max() < _STILL * voxel):
            break
    cells = np.unique(np.floor(places / (BEND * voxel)), axis=0, return_inverse=True)[1].ravel()
    bend = np.sum(np.bincount(cells, residuals) ** 2 / np.bincount(cells)) / len(residuals)
    deviation = np.sqrt(bend / resisted) / radius
    return Similarity(*split_scale(transform), float(resisted), float(deviation))


def _scaled(given: Given, scale: float) -> Given:
    """Return a scan in another unit."""
    scan, place = given.whole, given.viewpoint
    cloud = Cloud(scale * in_double(scan.cloud.points), name=scan.name)
    if place is not None and not isinstance(place, ViewDirection):
        place = scale * np.asarray(place, dtype=np.float64)
    return given._replace(scan=replace(scan, cloud=cloud, rounding=scale * scan.rounding), viewpoint=place)


def _weigh_scales(
    found: Found, scale: float, candidates: list[Candidate], tried: int, *, is_open: bool
) -> Found:
    """Share the probability with other scales: those that were tried, and those at which a pose was found."""
    best = candidates[0]
    least = 2 * np.log(GRID)
    rivals = [other for other in candidates[1:] if abs(np.log(other.scale / best.scale)) > least]
    shares = share_probability(best.case, [rival.case for rival in rivals])[1]
    chance = 1 / (1 / share_probability(found.cases[0], found.cases[1:], tried)[0] + float(shares.sum()))
    chance = bound_by_motions(chance, MOST_OPEN_MOTIONS + 1 if is_open else found.motions)
    others = [rival.pose @ scaling(rival.scale / scale) for rival in rivals]
    alike = np.reshape(others, (-1, 4, 4))[are_alternatives(chance, shares)]
    return replace(found, probability=chance, alternatives=np.concatenate([found.alternatives, alike]))


def _unscaled(done: Registration, scale: float, deviation: float) -> Registration:
    """Return the registration of the source as it was given."""
    change = scaling(scale)
    pose, matches = done.T_target_source @ change, scale_matches(done.correspondences, 1 / scale)
    positions, grouping = (matches.source, matches.target), done.grouping
    rule = None if grouping.rule is None else replace(grouping.rule, agreement=None)  # of unscaled lengths
    return replace(
        done,
        T_target_source=pose,
        scale=scale,
        scale_deviation=deviation,
        alternatives=done.alternatives @ change,
        correspondences=matches,
        grouping=replace(grouping, model=pose, rule=rule, _positions=positions),
    )
