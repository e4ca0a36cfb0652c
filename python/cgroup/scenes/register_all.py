"""Register many scans: poses of all in one scene, or in several."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup._checks.arrays import as_direction, as_floats
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_choice, as_items
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import StageClock, as_stage_function, ignore_progress
from cgroup._runtime.workers import count_workers, work_side_by_side
from cgroup.errors import InputError
from cgroup.registration.prepare import agree, as_given
from cgroup.registration.register import as_pairs, as_viewpoints
from cgroup.registration.scan import MAX_SIZE_RATIO, as_viewpoint
from cgroup.registration.search import EFFORTS
from cgroup.rigid import check_rigid
from cgroup.scenes.building import Building
from cgroup.scenes.workers import open_workers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import ArrayLike

    from cgroup.features import Cloud
    from cgroup.registration import PreparedScan
    from cgroup.registration.prepare import Given
    from cgroup.registration.search import Effort
    from cgroup.scenes.scene import Scene
    from cgroup.types import AnyCloud, FloatArray


@report_refused_memory()
@explain_wrong_calls
def register_all(
    scans: Sequence[PreparedScan | Cloud | AnyCloud],
    *,
    names: Sequence[str] | None = None,
    viewpoints: Sequence[ArrayLike | None] | None = None,
    viewpoint: ArrayLike | None = None,
    view_direction: ArrayLike | None = None,
    axis: ArrayLike | None = None,
    pairs: Iterable[tuple[int, int]] | None = None,
    odometry: ArrayLike | None = None,
    voxel: float | None = None,
    effort: Effort = "normal",
    keep: str | os.PathLike[str] | None = None,
    scheduler: Any = None,  # noqa: ANN401 - an address, or a client of Dask, which may not be installed
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Scene:
    """Place many scans, each in its own frame, in one scene, or in several.

    Scans may come in any order. Those that look alike as a whole are registered pair by pair. All poses are
    then decided on together: what the others contradict is dropped, what they confirm is kept, even where two
    scans alone could not tell. Components that pairs don't join are registered as unions. At last all scans
    are refined together on their surfaces.

    Parameters
    ----------
    scans : sequence of PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float
        Two or more, in the same unit. One that can't be worked with is left out, and `Scene.notes` says so.
    names : sequence of str, optional
        What notes call them; by default the names of files, or ``"scan 3"``.
    viewpoints : sequence of (3,) array_like of float or None, optional
        Where the scanner stood, in the frame of each scan; None for what its file says, if it does.
    viewpoint : (3,) array_like of float, optional
        The same for all scans.
    view_direction : (3,) array_like of float, optional
        Where the scanner looked, in the frame of each scan, where its place is not known or its rays are
        parallel.
    axis : (3,) array_like of float, optional
        A direction that all scans share, such as that of gravity; a pose may tilt it by 10 degrees.
    pairs : iterable of (int, int), optional
        Rows of `scans` that are registered, and no others. By default all pairs of up to 20 scans; of
        more, each scan with those that look most like it.
    odometry : (N,4,4) array_like of float, optional
        Poses of the scans, in order, by other sensors. Neighbours are then linked even where their surfaces
        don't tell.
    voxel : float, optional
        Edge length of the voxels, in the unit of the points; by default such that some 4,500 are left, on
        average of all scans.
    effort : {"low", "normal", "high"}
        How long to search for the pose of a pair.
    keep : path, optional
        File of finished pairs: a run that was ended goes on from there.
    scheduler : str or distributed.Client, optional
        Address of a Dask cluster to work on, its client, or "local". By default the threads of this process.
    threads : int, optional
        Scans or pairs worked on at a time; None for one per core.
    progress : callable, optional
        Called with the name of each stage, and with ``"pair 5 of 45"`` as each begins.

    Returns
    -------
    Scene
        Poses, components, edges.

    Raises
    ------
    InputError
        If no two scans are left that can be worked with, or an option can't be; the message names it.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.scenes import register_all
    >>> views = [standin_pair(seed=1, turn=turn, pixels=60) for turn in (40, 80)]
    >>> scene = register_all([views[0].source, views[0].target, views[1].target])
    >>> scene.components
    [[0, 1, 2]]
    """
    as_choice("effort", effort, EFFORTS)
    workers = count_workers(threads)
    begin = as_stage_function(progress)
    given = as_items("scans", scans, "give two clouds or more")
    if len(given) < 2:
        raise InputError("scans", f"{len(given)}", "give two or more")
    places = as_viewpoints(viewpoints, as_viewpoint(viewpoint, view_direction), len(given))
    direction = None if axis is None else as_direction("axis", axis, "(0, 0, 1)")
    wanted = None if pairs is None else as_pairs(pairs, len(given))
    moved = None if odometry is None else _as_odometry(odometry, len(given))
    called = _as_names(names, given)
    clock = StageClock(begin)
    clock.start("scans")
    ready, notes = _prepare_each(given, places, called, voxel, threads, workers, begin)
    rows = [row for row, scan in enumerate(ready) if scan is not None]
    prepared = [scan for scan in ready if scan is not None]
    if len(prepared) < 2:
        raise InputError(
            "scans", f"{len(prepared)} that can be worked with", f"give two or more; {'; '.join(notes)}"
        )
    within = {row: k for k, row in enumerate(rows)}
    if wanted is not None:
        wanted = [
            (within[one], within[other])
            for one, other in wanted
            if one in within and other in within and one != other
        ]
    with open_workers(prepared, threads, scheduler, keep, begin) as call:
        building = Building(prepared, call, direction, effort, clock)
        building.register_pairs(wanted, None if moved is None else moved[rows])
        scene = building.finish()
    return _spread(scene, rows, given, called, tuple(notes), building)


def add_scan(scene: Scene, scan: PreparedScan | Cloud | AnyCloud, viewpoint: ArrayLike | None) -> Scene:
    """Return the scene with one more scan."""
    if scene.made is None:
        raise InputError("scene", "one that was put together by hand", "make it by `register_all`")
    building, rows, notes = scene.made
    name, row = f"scans[{len(scene.scans)}]", len(scene.scans)
    shared = agree([as_given(name, building.scans[0])], None, None, None)._replace(threads=1)
    ready = shared.finish(as_given(name, scan, viewpoint, or_stored=True), ignore_progress)
    with open_workers([*building.scans, ready], None) as call:
        grown = building.grown(ready, call)
        found = grown.finish()
    names = [*scene.names, *_as_names(None, [*scene.scans, scan])[row:]]
    return _spread(found, [*rows, row], [*scene.scans, scan], names, notes, grown)


def _as_names(names: Sequence[str] | None, given: Sequence[Any]) -> list[str]:
    """Return what scans are called."""
    if names is None:
        return [
            Path(scan).name if isinstance(scan, str | os.PathLike) else f"scan {row}"
            for row, scan in enumerate(given)
        ]
    told = [str(name) for name in as_items("names", names, "give one per scan")]
    if len(told) != len(given):
        raise InputError("names", f"{len(told)} for {len(given)} scans", "give one per scan")
    return told


def _as_odometry(odometry: ArrayLike, count: int) -> FloatArray:
    poses = as_floats("odometry", odometry)
    if poses.shape != (count, 4, 4):
        raise InputError("odometry", f"shape {poses.shape}", f"give ({count},4,4), the pose of each scan")
    return np.array([check_rigid(pose, f"odometry[{row}]") for row, pose in enumerate(poses)])


def _prepare_each(
    given: Sequence[Any],
    places: Sequence[ArrayLike | None],
    names: Sequence[str],
    voxel: float | None,
    threads: int | None,
    workers: int,
    begin: Callable[[str], Any],
) -> tuple[list[PreparedScan | None], list[str]]:
    """Make scans ready with one voxel; leave out those that can't be, and say why."""
    notes: dict[int, str] = {}
    clouds: list[Given | None] = [None] * len(given)

    def check(row: int, stop_with_the_others: Callable[[], None]) -> None:
        stop_with_the_others()
        try:
            clouds[row] = as_given(f"scans[{row}]", given[row], places[row], or_stored=True)
        except (InputError, OSError) as error:
            notes[row] = f"{names[row]} is left out: {_cause(error, names[row])}"

    work_side_by_side(range(len(given)), check, workers)
    sizes = {row: cloud.whole.cloud.diagonal for row, cloud in enumerate(clouds) if cloud is not None}
    usual = float(np.median(list(sizes.values()))) if sizes else 0.0
    for row, size in sizes.items():
        if not usual / MAX_SIZE_RATIO**0.5 <= size <= usual * MAX_SIZE_RATIO**0.5:
            notes[row] = (
                f"{names[row]} is left out: {size:.3g} across where the others are {usual:.3g}; scale it to "
                "their unit"
            )
            clouds[row] = None
    usable = [cloud for cloud in clouds if cloud is not None]
    ready: list[PreparedScan | None] = [None] * len(given)
    if usable:
        shared = agree(usable, voxel, None, threads)._replace(threads=1)

        def prepare(row: int, stop_with_the_others: Callable[[], None]) -> None:
            cloud = clouds[row]
            if cloud is None:
                return
            begin(f"scan {row + 1} of {len(given)}")
            try:
                ready[row] = shared.finish(cloud, lambda _: stop_with_the_others())
            except InputError as error:
                notes[row] = f"{names[row]} is left out: {_cause(error, names[row])}"

        work_side_by_side(range(len(given)), prepare, workers)
    return ready, [notes[row] for row in sorted(notes)]


def _cause(error: Exception, name: str) -> str:
    """Say why a scan is left out, without its names, which stand before."""
    message = re.sub(r"^scans\[\d+\]: ", "", str(error))
    return message.removeprefix(f"{name}: ")


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


def _spread(
    scene: Scene,
    rows: list[int],
    given: Sequence[Any],
    names: list[str],
    notes: tuple[str, ...],
    building: Building,
) -> Scene:
    """Return the scene by the rows that were given, among which some were left out."""
    count = len(given)
    poses, covariance = np.full((count, 4, 4), np.nan), np.full((count, 6, 6), np.nan)
    probability = np.full(count, np.nan)
    poses[rows], covariance[rows], probability[rows] = scene.poses, scene.covariance, scene.probability
    alone = sum(len(part) == 1 for part in scene.components)
    found = [*notes]
    if len(scene.components) > 1:
        sizes = ", ".join(str(len(part)) for part in scene.components if len(part) > 1)
        several = (
            f"{_count(len(scene.components) - alone, 'scene')} of {sizes} scans"
            if sizes
            else "no two scans hang together"
        )
        found.append(several + (f", and {_count(alone, 'scan')} alone" if sizes and alone else ""))
    return replace(
        scene,
        poses=poses,
        covariance=covariance,
        probability=probability,
        components=[[rows[k] for k in part] for part in scene.components],
        edges=[replace(edge, source=rows[edge.source], target=rows[edge.target]) for edge in scene.edges],
        names=names,
        scans=tuple(given),
        notes=tuple(found),
        made=(building, rows, notes),
    )
