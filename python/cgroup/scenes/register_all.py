"""Register many scans into one scene, or several."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_direction
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_choice, as_index, as_items, refusal
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import StageClock, as_stage_function
from cgroup._runtime.workers import count_workers, work_side_by_side
from cgroup._show.words import counted
from cgroup.errors import InputError
from cgroup.features import Cloud
from cgroup.fronts.scan import MAX_SIZE_RATIO, as_viewpoint
from cgroup.io.clouds import find_clouds
from cgroup.registration import EFFORTS, Effort, PreparedScan
from cgroup.registration.pairwise import Given, agree, as_given, as_pairs, as_viewpoints
from cgroup.rigid import check_rigid
from cgroup.rigid.transforms import as_poses
from cgroup.scenes.building import SceneBuilder
from cgroup.scenes.scene import Scene
from cgroup.scenes.workers import open_workers
from cgroup.types import AnyCloud, FloatArray


@report_refused_memory()
@explain_wrong_calls
def register_all(
    scans: Sequence[PreparedScan | Cloud | AnyCloud] | str | os.PathLike[str],
    *,
    names: Sequence[str] | None = None,
    viewpoints: Sequence[ArrayLike | None] | None = None,
    viewpoint: ArrayLike | None = None,
    view_direction: ArrayLike | None = None,
    axis: ArrayLike | None = None,
    pairs: Iterable[tuple[int, int]] | None = None,
    odometry: ArrayLike | None = None,
    known: Mapping[int, ArrayLike] | None = None,
    voxel: float | None = None,
    effort: Effort = "normal",
    keep: str | os.PathLike[str] | None = None,
    scheduler: Any = None,  # noqa: ANN401 - an address, or a client of Dask, which may not be installed
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Scene:
    """Estimate the poses of many scans in one scene, or in several.

    Scans may come in any order. Similar scans are registered pair by pair. All pair poses are then selected
    together: poses that the others contradict are dropped, and uncertain poses that the others confirm are
    kept. Components without a common pair are registered as unions. Finally all scans are refined together on
    their surfaces. Further parameters are as for `register`.

    Parameters
    ----------
    scans : sequence of PreparedScan, PointCloud, Cloud, path or (N,3) array_like of float, or path
        Two or more, in the same unit. Unusable scans are left out and listed in `Scene.notes`. A single path
        is that of a folder, or a pattern such as ``"scans/*.ply"``; files are sorted by name.
    names : sequence of str, optional
        Names of the scans in notes; by default those of the files, or ``"scan 3"``.
    viewpoints : sequence of (3,) array_like of float or None, optional
        Positions of the scanners, one per scan; None for that of its file.
    pairs : iterable of (int, int), optional
        Rows of `scans` to register. By default all pairs of up to 20 scans; of more, each scan with the most
        similar ones.
    odometry : (N,4,4) array_like of float, optional
        Poses of the scans, in order, by other sensors. Neighbours are then linked even if their surfaces do
        not fix the pose.
    known : dict of int to (4,4) array_like of float, optional
        Poses of some rows of `scans`, such as those of `fit_targets`. They are kept exactly, and give the
        frame of their component. `Scene.notes` lists pairs of them that the surfaces contradict.
    keep : path, optional
        File of finished pairs, from which an interrupted run continues.
    scheduler : str or distributed.Client, optional
        Address of a Dask cluster, its client, or "local". By default the threads of this process.
    threads : int, optional
        Number of scans or pairs at a time; one per core by default.
    progress : callable, optional
        Called with the name of each stage, and with ``"pair 5 of 45"`` as each begins.

    Returns
    -------
    Scene
        Poses, components, edges.

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
    begin = as_stage_function(progress)
    if isinstance(scans, str | os.PathLike):
        scans = find_clouds("scans", [scans])
    given = as_items("scans", scans, "give two clouds or more")
    if len(given) < 2:
        raise InputError("scans", f"{len(given)}", "give two or more, a folder or a pattern")
    places = as_viewpoints(viewpoints, as_viewpoint(viewpoint, view_direction), len(given))
    direction = None if axis is None else as_direction("axis", axis, "(0, 0, 1)")
    wanted = None if pairs is None else as_pairs(pairs, len(given))
    moved = None if odometry is None else as_poses("odometry", odometry, len(given))
    fixed = _as_known({} if known is None else known, len(given))
    called = _as_names(names, given)
    clock = StageClock(begin)
    clock.start("scans")
    ready, notes = _prepare_each([*zip(called, given, places, strict=True)], voxel, threads, begin)
    if len(ready) < 2:
        got = f"{len(ready)} that can be worked with"
        raise InputError("scans", got, f"give two or more; {'; '.join(notes[:3])}")
    rows, scans = list(ready), list(ready.values())
    if wanted is not None:
        place = {row: number for number, row in enumerate(rows)}
        usable = [pair for pair in wanted if pair[0] != pair[1] and {*pair} <= place.keys()]
        wanted = [(place[one], place[other]) for one, other in usable]
    with open_workers(scans, threads, scheduler, keep, begin) as call:
        building = SceneBuilder(scans, call, direction, effort, clock)
        held = {number: fixed[row] for number, row in enumerate(rows) if row in fixed}
        building.register_pairs(wanted, None if moved is None else moved[rows], held)
        return _finish(building, rows, given, called, notes)


def add_scan(scene: Scene, scan: PreparedScan | Cloud | AnyCloud, viewpoint: ArrayLike | None) -> Scene:
    """Return the scene with a further scan."""
    if scene.made is None:
        raise InputError("scene", "one that was created by hand", "make it by `register_all`")
    building, rows, notes = scene.made
    given, row = [*scene.scans, scan], len(scene.scans)
    name = f"scans[{row}]"
    new = as_given(name, scan, viewpoint, or_stored=True)
    shared = agree([as_given(name, building.scans[0]), new], None, None, None)._replace(threads=1)
    ready = shared.finish(new).begin()
    names = [*scene.names, *_as_names(None, given)[row:]]
    with open_workers([*building.scans, ready], None) as call:
        return _finish(building.grown(ready, call), [*rows, row], given, names, notes)


def _as_names(names: Sequence[str] | None, given: Sequence[Any]) -> list[str]:
    if names is None:
        is_path = [isinstance(scan, str | os.PathLike) for scan in given]
        return [Path(scan).name if is_path[row] else f"scan {row}" for row, scan in enumerate(given)]
    told = [str(name) for name in as_items("names", names, "give one per scan")]
    if len(told) != len(given):
        raise InputError("names", f"{len(told)} for {len(given)} scans", "give one per scan")
    return told


def _as_known(known: Mapping[int, ArrayLike], count: int) -> dict[int, FloatArray]:
    if not isinstance(known, Mapping):
        raise refusal("known", known, "give a dict of poses by rows of `scans`")
    rows = [as_index("known", row, count, "scans") for row in known]
    return {row: check_rigid(pose, f"known[{row}]") for row, pose in zip(rows, known.values(), strict=True)}


def _prepare_each(
    named: list[tuple[str, Any, Any]], voxel: float | None, threads: int | None, begin: Callable[[str], Any]
) -> tuple[dict[int, PreparedScan], tuple[str, ...]]:
    """Prepare scans (name, cloud, viewpoint) with one voxel; return the reasons for unusable ones, too."""
    clouds: dict[int, Given] = {}
    ready: dict[int, PreparedScan] = {}
    reasons: dict[int, str] = {}

    @contextmanager
    def leaving_out(row: int) -> Generator[None, None, None]:
        try:
            yield
        except (InputError, OSError) as error:
            reasons[row] = str(error).removeprefix(f"scans[{row}]: ").removeprefix(f"{named[row][0]}: ")

    def check(row: int, stop_with_the_others: Callable[[], None]) -> None:
        stop_with_the_others()
        with leaving_out(row):
            clouds[row] = as_given(f"scans[{row}]", *named[row][1:], or_stored=True)

    def prepare(row: int, stop_with_the_others: Callable[[], None]) -> None:
        begin(f"scan {row + 1} of {len(named)}")
        with leaving_out(row):
            stop_with_the_others()
            ready[row] = shared.finish(clouds[row]).begin()

    workers = count_workers(threads)
    work_side_by_side(range(len(named)), check, workers)
    sizes = {row: clouds[row].whole.diagonal for row in sorted(clouds)}
    usual = float(np.median([*sizes.values()])) if sizes else 0.0
    for row, size in sizes.items():
        if not usual / MAX_SIZE_RATIO**0.5 <= size <= usual * MAX_SIZE_RATIO**0.5:
            reasons[row] = f"{size:.3g} across where the others are {usual:.3g}; scale it to their unit"
    usable = [row for row in sizes if row not in reasons]
    if usable:
        shared = agree([clouds[row] for row in usable], voxel, None, threads)._replace(threads=1)
        work_side_by_side(usable, prepare, workers)
    left_out = [f"{named[row][0]} is left out: {reasons[row]}" for row in sorted(reasons)]
    scans = {row: ready[row] for row in sorted(ready)}
    return scans, (*left_out, *_find_repeats([name for name, *_ in named], scans))


def _find_repeats(names: list[str], scans: dict[int, PreparedScan]) -> list[str]:
    """Return notes on scans with the points of an earlier one."""
    first: dict[bytes, int] = {}
    notes: list[str] = []
    for row, scan in scans.items():
        one = first.setdefault(sha256(scan.scan.cloud.points.tobytes()).digest(), row)
        if one != row:
            same = f"{names[row]} has the same points as {names[one]}"
            notes.append(f"{same}: the same scan twice adds nothing")
    return notes


def _finish(
    building: SceneBuilder, rows: list[int], given: Sequence[Any], names: list[str], notes: tuple[str, ...]
) -> Scene:
    """Return the scene by the rows of all input scans, including omitted ones."""
    scene = building.finish()

    def spread(values: FloatArray) -> FloatArray:
        every = np.full((len(given), *values.shape[1:]), np.nan)
        every[rows] = values
        return every

    contradictions = _list_contradictions(building, scene, [names[row] for row in rows])
    return replace(
        scene,
        poses=spread(scene.poses),
        probability=spread(scene.probability),
        covariance=spread(scene.covariance),
        components=[[rows[k] for k in part] for part in scene.components],
        edges=[replace(edge, source=rows[edge.source], target=rows[edge.target]) for edge in scene.edges],
        names=names,
        scans=tuple(given),
        notes=(*notes, *contradictions, *_say_components([len(part) for part in scene.components])),
        made=(building, rows, notes),
    )


def _list_contradictions(building: SceneBuilder, scene: Scene, names: list[str]) -> list[str]:
    dropped = [
        f"{names[edge.source]} and {names[edge.target]}: other scans contradict their known poses"
        for edge in scene.edges
        if (edge.source, edge.target) in building.known.pairs and not edge.kept
    ]
    return dropped + [
        f"{names[source]} on {names[target]}: their surfaces contradict the known poses, "
        f"by {turn:.2g} degrees and {way:.3g} at the middle"
        for source, target, turn, way in building.known.contradictions
    ]


def _say_components(sizes: list[int]) -> list[str]:
    several = [size for size in sizes if size > 1]
    if len(sizes) < 2 or not several:
        return ["no two scans are connected"] if len(sizes) > 1 else []
    said = f"{counted(len(several), 'scene')} of {', '.join(map(str, several))} scans"
    alone = len(sizes) - len(several)
    return [f"{said}, and {counted(alone, 'scan')} alone" if alone else said]
