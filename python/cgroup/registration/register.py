"""Register clouds: one pair, or many side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_direction
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.run_options import as_threads
from cgroup._checks.values import as_choice, as_count, as_instance, as_items, as_scale, refusal
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import StageClock, as_stage_function
from cgroup._runtime.workers import count_workers, work_side_by_side
from cgroup.errors import InputError, NoConsensusError
from cgroup.features import Cloud
from cgroup.group import check_method
from cgroup.registration.confirm import confirm_pose
from cgroup.registration.judge import Judgement, is_accepted, judge
from cgroup.registration.nearby import as_nearby
from cgroup.registration.own import as_matches, as_own_descriptors
from cgroup.registration.paper_front import PaperFront
from cgroup.registration.prepare import DenseFront, Given, PreparedScan, agree, as_given
from cgroup.registration.result import Registration, registration_of
from cgroup.registration.scale import register_scaled
from cgroup.registration.scan import as_viewpoint
from cgroup.registration.search import EFFORTS, Effort, Search
from cgroup.registry import MethodName
from cgroup.rigid import apply, check_rigid
from cgroup.types import AnyCloud, Correspondences
from cgroup.verification import verify

FRONTS = ("dense", "paper")

MOVED_BY_REFINING = 0.4
"""Voxels by which refining may move a right pose: half of its probability is left there."""


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
    """Place a source cloud on a target cloud, or say that no pose can be trusted.

    Both clouds are thinned to voxels, and matched by FPFH. Groups of matches propose poses; these are
    verified on the two surfaces (`cgroup.verification`), the best is refined, and judged. Of `front`,
    `matches`, `descriptors` and `initial` one can be given.

    Neither the frames of the clouds, the order of their points, their unit, nor which is the source changes
    the verdict, beyond rounding: grids and samples follow each cloud's own axes. Rounding may decide where
    the probability is near 0.5, and where a shape has no axes of its own, as a ball, a cube or a disk. With
    the paper's front, `matches` or `descriptors` the order and the roles count too.

    Parameters
    ----------
    source, target : PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float
        Whole clouds, in the same unit unless `scale` says otherwise. To register one cloud with many,
        `prepare` it once.
    voxel : float, optional
        Edge length of the voxels, in the unit of the points: the one length that all others are multiples
        of. By default such that some 4,500 voxels are left, on average of the two, and 1,000 or more of each.
    viewpoint : (3,) array_like of float, optional
        Where the scanner stood, in the frame of each cloud, if each is one single scan. What lies before its
        surface then speaks against a pose; at low overlap nothing helps more. Not for clouds fused from
        several. By default what the file of each says, `PointCloud.viewpoint`.
    source_viewpoint, target_viewpoint : (3,) array_like of float, optional
        The same of one of them, where they differ.
    view_direction : (3,) array_like of float, optional
        Where the scanner looked, in the frame of each cloud, where its place is not known or its rays are
        parallel: (0, 0, -1) for most scanners of objects on a turntable.
    axis : (3,) array_like of float, optional
        A direction that both clouds share, such as that of gravity; the pose may tilt it by 10 degrees.
    effort : {"low", "normal", "high"}
        How long to search: mutual matches only; all matches where these aren't enough; and then finer voxels
        with the three nearest matches of each.
    front : {"dense", "paper"}, DenseFront or PaperFront
        Where matches come from: every voxel, or the keypoints of a detector, as `correspond` matches them.
    matches : Correspondences or (i, j), optional
        Matches of your own, such as a network's: positions, or (n,) rows of matched points of the two clouds
        as they were given. They alone propose poses, also by their frames.
    descriptors : (a, b), optional
        Descriptors of your own, (N,D) of float for either cloud: one row for each point of the cloud as it
        was given, NaN for none. The first described point of each voxel is matched by them.
    initial : (4,4) array_like of float, optional
        Maps the source into the target's frame roughly, such as a prior of odometry. The pose is sought near
        it, on the surfaces alone: nothing is matched.
    radius : float, optional
        How far `initial` may place the middle of the source from where it belongs, in the unit of the points;
        a fifth of the source's diagonal unless given.
    angle : float, optional
        Degrees by which `initial` may be turned, 15 unless given.
    scale : bool or (float, float)
        Whether the clouds are in different units: then the length in the target is sought that the source's
        unit has, between the two bounds if they are given. True allows any unit: the scale is sought where
        both clouds are of about the same size, to a factor of 3, and bounds only narrow that. All lengths
        told, and those of the result, are in the target's unit. Neither `matches`, `descriptors`, `initial`,
        the paper's front nor prepared scans can be given beside it.
    method : str, optional
        Grouping method that proposes poses, one of `cgroup.METHODS`; "lc" unless given, "gtm" with the
        paper's front.
    threads : int, optional
        Threads to compute on, None for all cores.
    progress : callable, optional
        Called with the name of each stage as it begins.
    **options
        Options of the grouping method.

    Returns
    -------
    Registration
        With `Registration.ok`, always.

    Raises
    ------
    NoConsensusError
        If no pose can be trusted; its ``registration`` is the best guess, or None where there is not even
        one.
    InputError
        If a cloud or an option can't be worked with; the message names it.
    OutOfMemoryError
        Where the system gives no memory for the computation.

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
    direction = None if axis is None else as_direction("axis", axis, "(0, 0, 1)")
    dense, paper = _fronts_of(front)
    bounds = as_scale("scale", scale)
    fronts = None if front == "dense" else front
    _check_alone({"matches": matches, "descriptors": descriptors, "initial": initial, "front": fronts})
    nearby = as_nearby(initial, radius, angle)
    if initial is not None and (method is not None or options):
        raise InputError("method", remedy="nothing is grouped where `initial` is given; leave it out")
    chosen = check_method(("lc" if paper is None else "gtm") if method is None else method, options, register)
    search = Search(chosen, options, direction, effort, as_threads(threads), clock, paper)
    both = as_viewpoint(viewpoint, view_direction)
    places = [both if own is None else own for own in (source_viewpoint, target_viewpoint)]
    if bounds is not None:
        _refuse_beside_scale(matches=matches, descriptors=descriptors, initial=initial, front=paper)
        registration, judgement = register_scaled(
            search, _as_both((source, target), places), voxel, dense, bounds
        )
    else:
        how = {"with_descriptors": initial is None}
        scans = _prepare_both((source, target), places, voxel, dense, search.threads, clock, **how)
        if nearby is not None:
            search = replace(search, nearby=nearby.around(scans[0]))
        elif matches is not None:
            search = replace(search, matches=as_matches(matches, *scans))
        elif descriptors is not None:
            search = replace(search, descriptors=as_own_descriptors(descriptors, *scans))
        registration, judgement = _register(search, *scans)
    if registration is not None and judgement.ok:
        return registration
    reason = judgement.reason
    if registration is None and search.nearby is not None:
        _, degrees, reach = search.nearby
        near = f"none fits within {reach:.4g} and {degrees:g} degrees of `initial`"
        reason = f"{near}; give a larger `radius` or `angle`, or no `initial`"
    error = NoConsensusError(f"no pose that can be trusted: {reason}")
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
    """Say how likely a pose from elsewhere is right.

    A pose of another library, of a network, or of odometry. It takes part in a search for the best one, and
    is weighed against all that the search finds, as `register` weighs its own. It is right where the refined
    pose is, and refining moves the source by little: half of that probability is left at 0.4 voxel.

    Parameters
    ----------
    source, target : PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float
        As for `register`.
    T_target_source : (4,4) array_like of float
        Maps source points into the target's frame.
    voxel : float, optional
        Edge length of the voxels, as for `register`.
    viewpoint : (3,) array_like of float, optional
        Where the scanner stood, in the frame of each cloud, if each is one single scan; by default what the
        file of each says, `PointCloud.viewpoint`.
    source_viewpoint, target_viewpoint : (3,) array_like of float, optional
        The same of one of them, where they differ.
    view_direction : (3,) array_like of float, optional
        Where the scanner looked, in the frame of each cloud, where its place is not known or its rays are
        parallel: (0, 0, -1) for most scanners of objects on a turntable.
    axis : (3,) array_like of float, optional
        A direction that both clouds share.
    effort : {"low", "normal", "high"}
        How long to search for a better pose.
    threads : int, optional
        Threads to compute on, None for all cores.
    progress : callable, optional
        Called with the name of each stage as it begins.

    Returns
    -------
    Registration
        Of the pose as it was given; why it is refused stands first among the `notes`. The best pose that the
        search found is the first of the `alternatives` where it is another one.

    Raises
    ------
    NoConsensusError
        If no pose keeps the axis.
    InputError
        If a cloud, the pose or an option can't be worked with; the message names it.
    OutOfMemoryError
        Where the system gives no memory for the computation.

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
    both = as_viewpoint(viewpoint, view_direction)
    places = [both if own is None else own for own in (source_viewpoint, target_viewpoint)]
    scans = _prepare_both((source, target), places, voxel, None, search.threads, clock)
    found = search.run(*scans)
    if found is None:
        message = "no pose that keeps the axis, neither that given nor another"
        raise NoConsensusError(message)
    points, best = found.source.voxels.points, found.refined.T_target_source
    moved = float(np.sqrt(((apply(given, points) - apply(best, points)) ** 2).sum(axis=1).mean()))
    chance = found.probability * 0.5 ** (moved / (MOVED_BY_REFINING * found.source.voxel)) ** 4
    judgement = judge(replace(found, probability=chance), *scans, direction)
    notes = judgement.notes
    others = found.alternatives
    if is_accepted(found.probability) and not judgement.ok:
        far = moved > found.source.scan.cloud.diagonal + found.target.scan.cloud.diagonal
        where = f"{moved:.3g} away on average over the source, {moved / found.source.voxel:.1f} voxels"
        where = (
            "elsewhere: the pose given leaves the clouds far apart; check its unit and frames"
            if far
            else where
        )
        better = f"a better pose lies {where}"
        notes = (better, *notes)
        others = np.concatenate([best[None], others])
    elif judgement.reason:
        notes = (judgement.reason, *notes)
    done = registration_of(found, judgement, clock.stop())
    return replace(done, T_target_source=given, notes=notes, alternatives=others)


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
    """Refine a pose from elsewhere on the surfaces, and judge it by itself.

    For a pose that is right to some three voxels; where it is known roughly only, give it to `register` as
    `initial`. No other place is looked at, so that of two that look the same either is accepted: `assess`
    seeks such rivals.

    Parameters
    ----------
    source, target : PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float
        As for `register`.
    T_target_source : (4,4) array_like of float
        Maps source points into the target's frame.
    voxel : float, optional
        Edge length of the voxels, as for `register`.
    viewpoint : (3,) array_like of float, optional
        Where the scanner stood, in the frame of each cloud, if each is one single scan; by default what the
        file of each says, `PointCloud.viewpoint`.
    source_viewpoint, target_viewpoint : (3,) array_like of float, optional
        The same of one of them, where they differ.
    view_direction : (3,) array_like of float, optional
        Where the scanner looked, in the frame of each cloud, where its place is not known or its rays are
        parallel.
    threads : int, optional
        Threads to compute on, None for all cores.
    progress : callable, optional
        Called with the name of each stage as it begins.

    Returns
    -------
    Registration
        Of the refined pose, without matches; where it is refused, the reason stands first among the `notes`.

    Raises
    ------
    NoConsensusError
        If the pose lays nothing together.
    InputError
        If a cloud, the pose or an option can't be worked with; the message names it.
    OutOfMemoryError
        Where the system gives no memory for the computation.

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
    both = as_viewpoint(viewpoint, view_direction)
    places = [both if own is None else own for own in (source_viewpoint, target_viewpoint)]
    how = {"with_descriptors": False}
    scans = _prepare_both((source, target), places, voxel, None, workers, clock, **how)
    clock.start("verification")
    verified = verify(scans[0].surface, scans[1].surface, given, threads=workers)
    clock.start("refinement")
    found = confirm_pose(*scans, verified.T_target_source, workers)
    if found is None:
        message = "the pose lays nothing together; give one that is right to some three voxels"
        raise NoConsensusError(message)
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

    Every scan is made ready once, however many pairs it is in. All have the same voxel.

    Parameters
    ----------
    scans : sequence of PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float
        Two or more, in the same unit.
    pairs : iterable of (int, int), optional
        Rows of `scans`: which is moved, and which it is moved to. By default all pairs, each scan moved to
        those before it.
    voxel : float, optional
        Edge length of the voxels, in the unit of the points; by default such that some 4,500 are
        left, on average of all scans.
    viewpoint : (3,) array_like of float, optional
        Where the scanner stood, in the frame of each scan, if each is one single scan.
    viewpoints : sequence of (3,) array_like of float or None, optional
        The same where they differ, one per scan; None for what its file says, if it does.
    view_direction : (3,) array_like of float, optional
        Where the scanner looked, in the frame of each scan, where its place is not known or its rays are
        parallel.
    axis : (3,) array_like of float, optional
        A direction that all clouds share, such as that of gravity; a pose may tilt it by 10 degrees.
    effort : {"low", "normal", "high"}
        How long to search: mutual matches only; all matches where these aren't enough; and then finer voxels
        with the three nearest matches of each.
    front : DenseFront, optional
        Radii of normals, frames and descriptors, in voxels.
    method : str
        Grouping method that proposes poses, one of `cgroup.METHODS`.
    threads : int, optional
        Number of scans, then of pairs worked on at a time; None for one per core.
    progress : callable, optional
        Called with ``"scan 3 of 10"`` or ``"pair 5 of 45"`` as each begins, by several threads.
    **options
        Options of the grouping method.

    Returns
    -------
    list of Registration or None
        In the order of the pairs. `Registration.ok` is false where the pose can't be trusted; None where not
        even a guess was found.

    Raises
    ------
    InputError
        If a scan, a pair or an option can't be worked with; the message names it.
    OutOfMemoryError
        Where the system gives no memory for the computation.

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
        return shared.finish(clouds[row], lambda _: stop_with_the_others())

    def register_one(number: int, stop_with_the_others: Callable[[], None]) -> Registration | None:
        begin(f"pair {number + 1} of {len(wanted)}")
        source, target = (prepared[row] for row in wanted[number])
        if source.by_frames or target.by_frames:
            source, target = source.turned_by_frames, target.turned_by_frames
        clock = StageClock(lambda _: stop_with_the_others())
        return _register(Search(proposer, options, direction, effort, 1, clock), source, target)[0]

    prepared = work_side_by_side(rows, make_ready, workers)
    return work_side_by_side(range(len(wanted)), register_one, workers)


def _prepare_both(
    clouds: Sequence[PreparedScan | Cloud | AnyCloud],
    viewpoints: Sequence[ArrayLike | None],
    voxel: float | None,
    front: DenseFront | None,
    threads: int | None,
    clock: StageClock,
    *,
    with_descriptors: bool = True,
) -> tuple[PreparedScan, PreparedScan]:
    """Make source and target ready."""
    clock.start("voxel size")
    given = _as_both(clouds, viewpoints)
    shared = agree(given, voxel, front, threads)
    by_frames = any(cloud.by_frames for cloud in given)
    how = {"by_frames": by_frames, "with_descriptors": with_descriptors}
    source, target = (shared.finish(one, clock.start, **how) for one in given)
    return source, target


def _as_both(
    clouds: Sequence[PreparedScan | Cloud | AnyCloud], viewpoints: Sequence[ArrayLike | None]
) -> tuple[Given, Given]:
    """Check source and target."""
    source, target = (
        as_given(name, cloud, place, or_stored=True)
        for name, cloud, place in zip(("source", "target"), clouds, viewpoints, strict=True)
    )
    return source, target


def _register(
    search: Search, source: PreparedScan, target: PreparedScan
) -> tuple[Registration | None, Judgement]:
    """Search for the pose of two scans that are ready, and judge it."""
    found = search.run(source, target)
    judgement = judge(found, source, target, search.axis)
    return None if found is None else registration_of(found, judgement, search.clock.stop()), judgement


def _fronts_of(front: object) -> tuple[DenseFront | None, PaperFront | None]:
    """Return the dense front that is given, if one is, and the paper's front where it is to be used."""
    if isinstance(front, DenseFront | PaperFront):
        return (front, None) if isinstance(front, DenseFront) else (None, front)
    if not isinstance(front, str) or front not in FRONTS:
        remedy = f"choose one of {', '.join(FRONTS)}, or give a DenseFront or PaperFront"
        raise refusal("front", front, remedy)
    return None, None if front == "dense" else PaperFront()


def _check_alone(given: Mapping[str, object]) -> None:
    """Refuse two ways to propose poses."""
    names = [name for name, value in given.items() if value is not None]
    if len(names) > 1:
        raise InputError(", ".join(names), remedy="give one of them: each says alone where poses come from")


def _refuse_beside_scale(**others: object) -> None:
    """Refuse what is told in the source's unit, which is not known."""
    for name, value in others.items():
        if value is not None:
            both = f"scale, {name}"
            raise InputError(both, remedy=f"the scale is sought by all voxels; leave out `{name}`")


def as_pairs(pairs: Iterable[tuple[int, int]], scans: int) -> list[tuple[int, int]]:
    """Check pairs of rows."""
    checked: list[tuple[int, int]] = []
    remedy = "give two rows of scans, source and target"
    for number, pair in enumerate(as_items("pairs", pairs, f"for each pair {remedy}")):
        name = f"pairs[{number}]"
        rows = as_items(name, pair, remedy)
        if len(rows) != 2:
            raise refusal(name, pair, remedy)
        source, target = (as_count(name, row, 0) for row in rows)
        if max(source, target) >= scans:
            raise InputError(name, f"{(source, target)}, but there are {scans} scans", "rows begin with 0")
        checked.append((source, target))
    return checked


def as_viewpoints(
    viewpoints: Sequence[ArrayLike | None] | None, shared: ArrayLike | None, scans: int
) -> Sequence[ArrayLike | None]:
    """Return one per scan; check that there is, where each has its own."""
    if viewpoints is None:
        return [shared] * scans
    if shared is not None:
        several = "viewpoint, view_direction, viewpoints"
        raise InputError(several, remedy="give one of them: a place, a direction, or one place per scan")
    places = as_items("viewpoints", viewpoints, "give one per scan, or None for it")
    if len(places) != scans:
        raise InputError(
            "viewpoints",
            f"{len(places)} for {scans} scans",
            "give one per scan, or None for it",
        )
    return places
