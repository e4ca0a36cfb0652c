"""Register one pair of clouds, or many."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_direction
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_choice, as_instance, as_items, as_scale, as_threads, refusal
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import StageClock, as_stage_function
from cgroup._runtime.workers import count_workers, work_side_by_side
from cgroup.errors import InputError, NoConsensusError
from cgroup.features import Cloud
from cgroup.fronts.paper_front import PaperFront
from cgroup.fronts.scan import as_viewpoint
from cgroup.group import check_method
from cgroup.registration.judge import Judgement, lock, share_left
from cgroup.registration.own import as_matches, as_nearby, as_own_descriptors
from cgroup.registration.pairwise import (
    EFFORTS,
    DenseFront,
    Effort,
    Given,
    PreparedScan,
    Registration,
    Search,
    agree,
    as_given,
    as_pairs,
    as_viewpoints,
    confirm_pose,
    judge,
    registration_of,
)
from cgroup.registration.scale import register_scaled
from cgroup.registry import MethodName
from cgroup.rigid import apply, check_rigid
from cgroup.rigid.locks import Locks, as_locks
from cgroup.types import AnyCloud, Correspondences
from cgroup.verification import verify

FRONTS = ("dense", "paper")


@report_refused_memory()
@explain_wrong_calls
def register(
    source: PreparedScan | Cloud | AnyCloud,
    target: PreparedScan | Cloud | AnyCloud,
    *,
    voxel: float | None = None,
    viewpoint: ArrayLike | None = None,
    source_viewpoint: ArrayLike | None = None,
    target_viewpoint: ArrayLike | None = None,
    view_direction: ArrayLike | None = None,
    axis: ArrayLike | None = None,
    free: str | None = None,
    effort: Effort = "normal",
    front: Literal["dense", "paper"] | DenseFront | PaperFront = "dense",
    matches: Correspondences | tuple[ArrayLike, ArrayLike] | None = None,
    descriptors: tuple[ArrayLike, ArrayLike] | None = None,
    initial: ArrayLike | None = None,
    radius: float | None = None,
    angle: float | None = None,
    scale: bool | tuple[float, float] = False,
    method: MethodName | str | None = None,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
    **options: Any,  # noqa: ANN401 - those of the method
) -> Registration:
    """Estimate the pose of a source in a target's frame; raise if none is reliable.

    Both clouds are downsampled to voxels and matched by FPFH. Groups of matches propose poses. These are
    verified on the two surfaces (`cgroup.verification`); the best is refined and judged. At most one of
    `front`, `matches`, `descriptors` and `initial` can be given.

    The result does not depend on the frames of the clouds, the order of their points, their unit, or their
    roles, beyond rounding. With the paper's front, `matches` or `descriptors`, order and roles count.

    Parameters
    ----------
    source, target : PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float
        Whole clouds, in the same unit unless `scale` is given. `prepare` a cloud once to register it with
        many.
    voxel : float, optional
        Edge length of the fine voxels, in the unit of the points; all other lengths are multiples of it. The
        search begins at twice this size. By default about 4,500 fine voxels are left on average of all
        clouds, and at least 1,000 of each.
    viewpoint : (3,) array_like of float, optional
        Position of the scanner, in the frame of each cloud, if each is a single scan. Points in front of the
        observed surface then count against a pose; this helps most at low overlap. Not for clouds fused from
        several scans. By default that of each cloud's file, `PointCloud.viewpoint`.
    source_viewpoint, target_viewpoint : (3,) array_like of float, optional
        The same for one cloud, if they differ.
    view_direction : (3,) array_like of float, optional
        Viewing direction of the scanner, in the frame of each cloud, if its position is unknown or its rays
        are parallel: (0, 0, -1) for most scanners of objects on a turntable.
    axis : (3,) array_like of float, optional
        A common direction of all clouds, such as gravity; a pose may tilt it by 10 degrees.
    free : str, optional
        Names of the parameters of the pose that are estimated, of ``roll, pitch, yaw`` (rotations about x, y
        and z of the target's frame) ``, x, y, z``: ``"yaw,x,y,z"`` for levelled scans. The others keep the
        values of `initial`, or zero. One rotation can be free, three or none.
    effort : {"low", "normal", "high"}
        Length of the search: mutual matches at coarse and at fine voxels only; all matches at fine ones if
        these are not enough; then also voxels of 0.7 of the fine ones, with three nearest matches of each.
    front : {"dense", "paper"}, DenseFront or PaperFront
        Source of the matches: every voxel, or the keypoints of a detector, as in `correspond`.
    matches : Correspondences or (i, j), optional
        Your own matches: positions, or (n,) rows of matched points of the input clouds. They alone propose
        poses, also by their frames.
    descriptors : (a, b), optional
        Precomputed descriptors: one (N,D) array per cloud, one row per input point, NaN where a point has
        none. The first described point of each voxel is matched.
    initial : (4,4) array_like of float, optional
        Rough pose of the source in the target's frame, such as odometry. The pose is searched for near it, on
        the surfaces only, without matches.
    radius : float, optional
        Largest error of `initial` at the centre of the source, in the unit of the points; a fifth of the
        source's diagonal by default.
    angle : float, optional
        Largest error of the rotation of `initial`, in degrees; 15 by default.
    scale : bool or (float, float)
        Whether to estimate the scale: the length in the target of the source's unit, within two bounds if
        given. In equal units, the sizes of the clouds may differ by a factor of 3; bounds only narrow this
        range. All lengths, also those of the result, are in the target's unit. Not together with `matches`,
        `descriptors`, `initial`, the paper's front or prepared scans.
    method : str, optional
        Grouping method that proposes poses, one of `cgroup.METHODS`; "lc" by default, "gtm" with the paper's
        front.
    threads : int, optional
        Number of threads; all cores by default. The result does not depend on it.
    progress : callable, optional
        Called with the name of each stage as it begins.
    **options
        Options of the grouping method.

    Returns
    -------
    Registration
        Always with true `Registration.ok`.

    Raises
    ------
    NoConsensusError
        If no pose is reliable; its ``registration`` is the best guess, or None without one.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import register
    >>> pair = standin_pair(pixels=60)
    >>> done = register(pair.source, pair.target)
    >>> done.ok
    True
    >>> bool(abs(done.T_target_source - pair.T_target_source).max() < done.voxel)
    True
    """
    as_choice("effort", effort, EFFORTS)
    clock = StageClock(as_stage_function(progress))
    proposed = {"matches": matches, "descriptors": descriptors, "initial": initial}
    dense, paper = _fronts_of(front, proposed)
    bounds = None if scale is False else as_scale("scale", scale)
    is_plain = initial is None and radius is None and angle is None
    nearby = None if is_plain else as_nearby(initial, radius, angle)
    locks = as_locks(free, None if nearby is None else nearby.pose)
    direction = locks.shared_axis if axis is None else as_direction("axis", axis, "(0, 0, 1)")
    if initial is not None and (method is not None or options):
        raise InputError("method", remedy="nothing is grouped where `initial` is given; leave it out")
    chosen = "lc" if paper is None else "gtm"
    if method is not None or options:
        chosen = check_method(chosen if method is None else method, options, register)
    search = Search(chosen, options, direction, effort, as_threads(threads), clock, paper)
    clock.start("voxel size")
    both = as_viewpoint(viewpoint, view_direction)
    given = _as_both(source, target, both, source_viewpoint, target_viewpoint)
    if bounds is not None:
        _refuse_beside_scale(**proposed, front=paper, free=free)
        registration, judgement = register_scaled(search, given, voxel, dense, bounds)
    else:
        scans = _prepare_both(given, voxel, dense, search.threads)
        if nearby is not None:
            search = replace(search, nearby=nearby.around(scans[0]))
        elif matches is not None:
            search = replace(search, matches=as_matches(matches, *scans))
        elif descriptors is not None:
            search = replace(search, descriptors=as_own_descriptors(descriptors, *scans))
        registration, judgement = _register(search, *scans, locks)
    if registration is not None and judgement.ok:
        return registration
    reason = judgement.reason
    if registration is None and search.nearby is not None:
        _, degrees, reach = search.nearby
        near = f"none fits within {reach:.4g} and {degrees:g} degrees of `initial`"
        reason = f"{near}; give a larger `radius` or `angle`, or no `initial`"
    error = NoConsensusError(f"no reliable pose: {reason}")
    error.registration = registration
    raise error


@report_refused_memory()
@explain_wrong_calls
def assess(
    source: PreparedScan | Cloud | AnyCloud,
    target: PreparedScan | Cloud | AnyCloud,
    T_target_source: ArrayLike,
    *,
    voxel: float | None = None,
    viewpoint: ArrayLike | None = None,
    source_viewpoint: ArrayLike | None = None,
    target_viewpoint: ArrayLike | None = None,
    view_direction: ArrayLike | None = None,
    axis: ArrayLike | None = None,
    effort: Effort = "normal",
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Registration:
    """Return the probability that a given pose is correct.

    The pose takes part in a search for the best one, and is compared with all poses that the search finds. It
    is right if the refined pose is, and if refining moves the source by little: half of the probability is
    left at 0.4 voxel. Further parameters are as for `register`.

    Parameters
    ----------
    T_target_source : (4,4) array_like of float
        Pose of the source in the target's frame, from any source.

    Returns
    -------
    Registration
        Of the given pose; the reason for a refusal is the first of the `notes`. A better pose that the search
        found is the first of the `alternatives`; the covariance of the given one is then NaN.

    Raises
    ------
    NoConsensusError
        If no pose keeps the axis.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import assess
    >>> pair = standin_pair(pixels=60)
    >>> wrong = pair.T_target_source.copy()
    >>> wrong[0, 3] += 10  # by about two voxels
    >>> [assess(pair.source, pair.target, T).ok for T in (pair.T_target_source, wrong)]
    [True, False]
    """
    as_choice("effort", effort, EFFORTS)
    clock = StageClock(as_stage_function(progress))
    direction = None if axis is None else as_direction("axis", axis, "(0, 0, 1)")
    given = check_rigid(T_target_source, "T_target_source")
    search = Search("lc", {}, direction, effort, as_threads(threads), clock, proposed=given[None])
    clock.start("voxel size")
    both = as_viewpoint(viewpoint, view_direction)
    clouds = _as_both(source, target, both, source_viewpoint, target_viewpoint)
    scans = _prepare_both(clouds, voxel, None, search.threads)
    found = search.run(*scans)
    if found is None:
        raise NoConsensusError("no pose that keeps the axis, neither that given nor another")
    points, best = found.points, found.pose
    moved = float(np.sqrt(((apply(given, points) - apply(best, points)) ** 2).sum(axis=1).mean()))
    chance, others = found.probability * share_left(moved / scans[0].voxel), found.alternatives
    [(fitness, target_fitness, rmse)] = found.overlap(np.ascontiguousarray(given)[None])
    there = {"fitness": fitness, "target_fitness": target_fitness, "rmse": rmse}
    placed = replace(found, pose=given, probability=chance, **there)
    judgement = judge(placed, *scans, direction)
    notes = judgement.notes
    if found.is_accepted and not judgement.ok:
        placed = replace(placed, covariance=lambda: np.full((6, 6), np.nan))
        far = moved > sum(scan.scan.cloud.diagonal for scan in scans)
        where = f"{moved:.3g} away on average over the source, {moved / scans[0].voxel:.1f} voxels"
        if far:
            where = "elsewhere: the pose given leaves the clouds far apart; check its unit and frames"
        notes = (f"a better pose is {where}", *notes)
        others = np.concatenate([best[None], others])
    elif judgement.reason:
        notes = (judgement.reason, *notes)
    done = registration_of(placed, judgement, clock.stop())
    return replace(done, notes=notes, alternatives=others)


@report_refused_memory()
@explain_wrong_calls
def refine(
    source: PreparedScan | Cloud | AnyCloud,
    target: PreparedScan | Cloud | AnyCloud,
    T_target_source: ArrayLike,
    *,
    voxel: float | None = None,
    viewpoint: ArrayLike | None = None,
    source_viewpoint: ArrayLike | None = None,
    target_viewpoint: ArrayLike | None = None,
    view_direction: ArrayLike | None = None,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Registration:
    """Refine a given pose on the surfaces, and estimate its probability alone.

    The error of the pose may be about three voxels; give a rougher one to `register` as `initial`. Only this
    place is examined: of two places that look the same either is accepted. `assess` searches for such rivals.
    Further parameters are as for `register`.

    Parameters
    ----------
    T_target_source : (4,4) array_like of float
        Pose of the source in the target's frame.

    Returns
    -------
    Registration
        Of the refined pose, without matches; the reason for a refusal is the first of the `notes`.

    Raises
    ------
    NoConsensusError
        If the surfaces do not meet under the pose.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import refine
    >>> pair = standin_pair(pixels=60)
    >>> rough = pair.T_target_source.copy()
    >>> rough[0, 3] += 10  # by about two voxels
    >>> done = refine(pair.source, pair.target, rough)
    >>> off = abs(done.T_target_source - pair.T_target_source).max()
    >>> done.ok, bool(off < 0.2 * done.voxel)
    (True, True)
    """
    clock, workers = StageClock(as_stage_function(progress)), as_threads(threads)
    given = check_rigid(T_target_source, "T_target_source")
    clock.start("voxel size")
    both = as_viewpoint(viewpoint, view_direction)
    clouds = _as_both(source, target, both, source_viewpoint, target_viewpoint)
    scans = _prepare_both(clouds, voxel, None, workers)
    clock.start("verification")
    verified = verify(scans[0].surface, scans[1].surface, given, threads=workers)
    clock.start("refinement")
    found = confirm_pose(*scans, verified.T_target_source, workers)
    if found is None:
        raise NoConsensusError("the surfaces do not overlap under the pose; it may be off by three voxels")
    judgement = judge(found, *scans)
    reason = (judgement.reason,) if judgement.reason else ()
    done = registration_of(found, judgement, clock.stop())
    return replace(done, notes=(*reason, *judgement.notes))


@report_refused_memory()
@explain_wrong_calls
def register_many(
    scans: Sequence[PreparedScan | Cloud | AnyCloud],
    pairs: Iterable[tuple[int, int]] | None = None,
    *,
    voxel: float | None = None,
    viewpoint: ArrayLike | None = None,
    viewpoints: Sequence[ArrayLike | None] | None = None,
    view_direction: ArrayLike | None = None,
    axis: ArrayLike | None = None,
    effort: Effort = "normal",
    front: DenseFront | None = None,
    method: MethodName | str = "lc",
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
    **options: Any,  # noqa: ANN401 - those of the method
) -> list[Registration | None]:
    """Register many pairs of scans, one thread each, on all cores.

    Every scan is prepared once, for all of its pairs, with the same voxel. Further parameters are as for
    `register`.

    Parameters
    ----------
    scans : sequence of PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float
        Two or more, in the same unit.
    pairs : iterable of (int, int), optional
        Rows of `scans`: source and target. By default each scan is registered to all before it.
    viewpoints : sequence of (3,) array_like of float or None, optional
        Positions of the scanners, one per scan; None for that of its file.
    front : DenseFront, optional
        Radii of normals, frames and descriptors, in voxels.
    threads : int, optional
        Number of scans, then of pairs, at a time; one per core by default.
    progress : callable, optional
        Called with ``"scan 3 of 10"`` or ``"pair 5 of 45"`` as each begins, by several threads.

    Returns
    -------
    list of Registration or None
        In the order of the pairs. `Registration.ok` is false if the pose is not reliable; None if there is
        not even a guess.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import register_many
    >>> pair, other = standin_pair(pixels=60), standin_pair(seed=1, pixels=60)
    >>> found = register_many([pair.target, pair.source, other.source])
    >>> [done is not None and done.ok for done in found]  # (1, 0), (2, 0), (2, 1)
    [True, False, False]
    """
    as_choice("effort", effort, EFFORTS)
    workers = count_workers(threads)
    if front is not None:
        as_instance("front", front, DenseFront)
    given = as_items("scans", scans, "give two clouds or more")
    if not given:
        raise InputError("scans", "none", "give two or more")
    checked = None if pairs is None else as_pairs(pairs, len(given))
    places = as_viewpoints(viewpoints, as_viewpoint(viewpoint, view_direction), len(given))
    direction = None if axis is None else as_direction("axis", axis, "(0, 0, 1)")
    begin, proposer = as_stage_function(progress), check_method(method, options, register_many)
    rows = range(len(given))
    clouds = [as_given(f"scans[{row}]", given[row], places[row], or_stored=True) for row in rows]
    shared = agree(clouds, voxel, front, threads)._replace(threads=1)
    wanted = [(source, target) for source in rows for target in range(source)] if checked is None else checked

    def make_ready(row: int, stop_with_the_others: Callable[[], None]) -> PreparedScan:
        if not clouds[row].is_ready:
            begin(f"scan {row + 1} of {len(clouds)}")
        stop_with_the_others()
        return shared.finish(clouds[row]).begin()

    def register_one(number: int, stop_with_the_others: Callable[[], None]) -> Registration | None:
        begin(f"pair {number + 1} of {len(wanted)}")
        source, target = (prepared[row] for row in wanted[number])
        if source.by_frames or target.by_frames:
            source, target = source.turned_by_frames, target.turned_by_frames
        clock = StageClock(lambda _: stop_with_the_others())
        return _register(Search(proposer, options, direction, effort, 1, clock), source, target)[0]

    prepared = work_side_by_side(rows, make_ready, workers)
    return work_side_by_side(range(len(wanted)), register_one, workers)


def _as_both(
    source: PreparedScan | Cloud | AnyCloud,
    target: PreparedScan | Cloud | AnyCloud,
    viewpoint: ArrayLike | None,
    of_source: ArrayLike | None,
    of_target: ArrayLike | None,
) -> tuple[Given, Given]:
    """Check two clouds, with a common viewpoint or one of each."""
    one, other = viewpoint if of_source is None else of_source, viewpoint if of_target is None else of_target
    first = as_given("source", source, one, or_stored=True)
    return first, as_given("target", target, other, or_stored=True)


def _prepare_both(
    given: tuple[Given, Given], voxel: float | None, front: DenseFront | None, threads: int | None
) -> tuple[PreparedScan, PreparedScan]:
    shared, (source, target) = agree(given, voxel, front, threads), given
    by_frames = source.by_frames or target.by_frames
    return shared.finish(source, by_frames=by_frames), shared.finish(target, by_frames=by_frames)


def _register(
    search: Search, source: PreparedScan, target: PreparedScan, locks: Locks | None = None
) -> tuple[Registration | None, Judgement]:
    found = search.run(source, target)
    judgement = judge(found, source, target, search.axis)
    if found is not None and locks is not None and locks.mask.any():
        found, judgement = lock(found, judgement, locks)
    return None if found is None else registration_of(found, judgement, search.clock.stop()), judgement


def _fronts_of(front: object, others: dict[str, Any]) -> tuple[DenseFront | None, PaperFront | None]:
    """Return the dense front if one is given, and the paper's front if it is used; only one may propose."""
    if not isinstance(front, DenseFront | PaperFront) and not (isinstance(front, str) and front in FRONTS):
        remedy = f"choose one of {', '.join(FRONTS)}, or give a DenseFront or PaperFront"
        raise refusal("front", front, remedy)
    given = {**others, "front": None if front == "dense" else front}
    names = [name for name, value in given.items() if value is not None]
    if len(names) > 1:
        raise InputError(", ".join(names), remedy="give one of them: each alone proposes the poses")
    if isinstance(front, str):
        return None, None if front == "dense" else PaperFront()
    return (front, None) if isinstance(front, DenseFront) else (None, front)


def _refuse_beside_scale(**others: object) -> None:
    """Raise for arguments in the source's unit, which is unknown."""
    for name, value in others.items():
        if value is not None:
            remedy = f"the scale is estimated from all voxels; leave out `{name}`"
            raise InputError(f"scale, {name}", remedy=remedy)
