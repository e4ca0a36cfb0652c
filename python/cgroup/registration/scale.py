"""Register clouds of unknown scale: the compiled core finds the scale, a search at that scale the pose."""

from dataclasses import replace

import numpy as np

from cgroup import _core
from cgroup._checks.arrays import in_double
from cgroup._checks.values import as_length, run_options
from cgroup.errors import InputError
from cgroup.features import Cloud
from cgroup.features.voxels import choose_thinning
from cgroup.fronts.matching import scale_matches
from cgroup.registration.judge import Found, Judgement, judge
from cgroup.registration.prepare import USUAL, VOXELS, DenseFront, Given, Preparation, PreparedScan, refused
from cgroup.registration.result import SEARCH, Registration, registration_of
from cgroup.registration.search import MAX_MATCHES, Search
from cgroup.rigid.transforms import scaling
from cgroup.types import FloatArray

UNCERTAIN = 0.01  # deviation of the scale from which a note is added


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
    search.clock.start(SEARCH)
    by_frames = any(one.by_frames for one in given)
    source, target = (_prepare(one, front or USUAL, search.threads, by_frames) for one in given)
    size = None if voxel is None else as_length("voxel", voxel)
    axis = None if search.axis is None else search.axis.tolist()
    options = run_options(search.threads, max_memory=MAX_MATCHES)
    scaled, refusal, excluded = _core.find_scale(source.core, target.core, bounds, size, axis, options)
    if refusal is not None:
        side, size, why = refusal
        raise refused((source, target)[side].scan, size, why)
    if excluded is not None:
        near = f"the clouds' sizes give {excluded[0]:.3g}, to a factor of {excluded[1]:g}"
        raise InputError("scale", "({:g}, {:g})".format(*bounds), f"{near}: give bounds around that ratio")
    assert scaled is not None  # noqa: S101 - one of the three
    source, target = _in_the_target_unit(scaled, source, target)
    found = None if scaled.pose is None else replace(search, proposed=scaled.pose[None]).run(source, target)
    if found is None:
        return None, judge(None, source, target, search.axis, scaled=True)
    probability, others = scaled.weigh(found.cases, found.motions)
    alike = np.array([pose @ scaling(scale / scaled.scale) for scale, pose in others]).reshape(-1, 4, 4)
    found = replace(
        found,
        probability=probability,
        alternatives=np.concatenate([found.alternatives, alike]),
        better_scale=1.0,
    )
    judgement = _judge(scaled, found, source, target, search.axis)
    seconds = search.clock.stop()
    seconds["scale"] = seconds[SEARCH] - sum(found.seconds.values())
    done = registration_of(found, judgement, seconds)
    return _unscaled(done, scaled.scale, scaled.deviation), judgement


def _prepare(given: Given, front: DenseFront, threads: int | None, by_frames: bool) -> PreparedScan:  # noqa: FBT001 - for one caller
    """Prepare a scan; the compiled core chooses other voxels."""
    voxel = choose_thinning(given.whole.cloud, voxels=VOXELS, threads=threads)
    return Preparation(voxel, front, threads).finish(given, by_frames=by_frames)


def _in_the_target_unit(
    scaled: _core.Scaled, source: PreparedScan, target: PreparedScan
) -> tuple[PreparedScan, PreparedScan]:
    scale, scan = scaled.scale, source.scan
    one, other, voxel = scaled.scans
    cloud = Cloud(scale * in_double(scan.cloud.points), name=scan.name)
    scan = replace(scan, cloud=cloud, mesh=None, rounding=scale * scan.rounding)
    eye = None if source.viewpoint is None else tuple(scale * part for part in source.viewpoint)
    return (
        replace(source, scan=scan, voxel=voxel, viewpoint=eye, core=one),
        replace(target, voxel=voxel, core=other),
    )


def _judge(
    scaled: _core.Scaled, found: Found, source: PreparedScan, target: PreparedScan, axis: FloatArray | None
) -> Judgement:
    judgement = judge(found, source, target, axis, scaled=True)
    if scaled.is_open:
        reason = "the surfaces leave the scale free, as a corner does: give clouds that show more"
        return replace(judgement, reason=reason)
    if scaled.deviation <= UNCERTAIN:
        return judgement
    why = "the surfaces fit as bent ones do, or show little of it"
    note = f"the scale is known to {100 * scaled.deviation:.1f} % only: {why}"
    return replace(judgement, notes=(*judgement.notes, note))


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
