"""Register clouds of unknown scale: propose scales, search at each, select the best.

Descriptors of voxels of two sizes are similar if the ratio of the sizes is the scale. Matches that agree on
one scale, as in TEASER++ (Yang, Shi, Carlone, T-RO 2021), refine it, and the surfaces finally fix it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cgroup import features
from cgroup._checks.arrays import in_double
from cgroup._runtime.progress import ignore_progress
from cgroup.errors import InputError
from cgroup.features import Cloud
from cgroup.features.voxels import choose_thinning
from cgroup.registration.judge import (
    MOST_OPEN_MOTIONS,
    Case,
    Found,
    Judgement,
    are_alternatives,
    bound_by_motions,
    judge,
    share_probability,
    weigh,
)
from cgroup.registration.matching import scale_matches
from cgroup.registration.motions import OPEN
from cgroup.registration.prepare import DenseFront, Given, Preparation, agree
from cgroup.registration.result import Registration, registration_of
from cgroup.registration.scan import ViewDirection
from cgroup.registration.search import Search
from cgroup.registration.similarity import Similarity, fit_similarity
from cgroup.rigid.transforms import scaling
from cgroup.types import FloatArray

WITHIN = 3.0  # factor around the ratio of the clouds' sizes within which the scale is searched
# Number of voxels at the finest size of description, number of sizes, and their ratio
VOXELS, SIZES, STEP = 2500, 4, 2**0.5
# Best matches of two sizes; largest disagreement and least distance of two of them, in voxels
MATCHES, AGREE, APART = 400, 1.0, 4.0
# Ratio of the tried scales, and their number to either side of a ratio of sizes
GRID, AROUND = 2 ** (1 / 16), 4
# Number of scales with a search, and their least consensus as a share of the greatest
CANDIDATES, AS_LIKELY = 2, 0.7
UNCERTAIN = 0.01  # deviation of the scale from which a note is added

_POWER_STEPS = 8


class Candidate(NamedTuple):
    """A rigid pose of the scaled source, and its evidence."""

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
    """Search for the similarity of two scans, and estimate its probability."""
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
        near = f"the clouds' sizes give {ratio:.3g}, to a factor of {WITHIN:g}"
        raise InputError("scale", f"({bounds[0]:g}, {bounds[1]:g})", f"{near}: give bounds around that ratio")
    return low, high


class _Described(NamedTuple):
    """Voxels of one size that have descriptors."""

    voxel: float
    points: FloatArray
    descriptors: NDArray[np.float32]


def _describe_sizes(
    given: Given, radii: DenseFront, threads: int | None, *, by_frames: bool
) -> list[_Described]:
    """Describe a scan at voxels of several sizes, as long as it remains a surface."""
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


def _scaled(given: Given, scale: float) -> Given:
    scan, place = given.whole, given.viewpoint
    cloud = Cloud(scale * in_double(scan.cloud.points), name=scan.name)
    if place is not None and not isinstance(place, ViewDirection):
        place = scale * np.asarray(place, dtype=np.float64)
    return given._replace(
        scan=replace(scan, cloud=cloud, mesh=None, rounding=scale * scan.rounding), viewpoint=place
    )


def _weigh_scales(
    found: Found, scale: float, candidates: list[Candidate], tried: int, *, is_open: bool
) -> Found:
    """Divide the probability among the scales: all tried ones, and those with a pose."""
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
