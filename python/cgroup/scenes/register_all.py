"""Register many scans: poses of all in one scene, or in several."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup._checks.arrays import as_direction
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_choice, as_items
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import StageClock, as_stage_function, ignore_progress
from cgroup._runtime.workers import count_workers, work_side_by_side
from cgroup.errors import InputError
from cgroup.registration.judge import ACCEPTED, SURE
from cgroup.registration.motions import adjoint
from cgroup.registration.prepare import agree, as_given
from cgroup.registration.register import as_pairs, as_viewpoints
from cgroup.registration.scan import MAX_SIZE_RATIO, as_viewpoint
from cgroup.registration.search import EFFORTS
from cgroup.rigid import check_rigid, invert
from cgroup.scenes.agreement import DISAGREES, squared_errors, weigh_by_triangles
from cgroup.scenes.decide import Decision, anchor, decide, errors_of, find_agreeing, follow_best, graph_of
from cgroup.scenes.join import cross_tasks, link_unions, propose_joins, task_of, weigh_join
from cgroup.scenes.links import Link, confirm, link
from cgroup.scenes.partners import choose_partners, describe_scans
from cgroup.scenes.refine import find_overlapping, lay_on_each_other
from cgroup.scenes.scene import Edge, Scene
from cgroup.scenes.workers import open_workers

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import ArrayLike

    from cgroup.features import Cloud
    from cgroup.registration import PreparedScan
    from cgroup.registration.prepare import Given
    from cgroup.registration.search import Effort
    from cgroup.scenes.workers import CallEach
    from cgroup.types import AnyCloud, FloatArray

ALL_PAIRS = 20
"""Scans up to which every pair is tried."""

PARTNERS, BUDGET = 6, 10
"""Partners that each scan is tried with at first, and pairs per scan that are tried at most."""

DEBUG=None
_ROUNDS = 2  # of laying all scans on each other
_JOINED = 3  # rounds of joining components
_ODOMETRY = (np.radians(3.0), 2.0)  # deviations of odometry: radians, voxels


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
    """Place many scans, in any order, each in its own frame, in one scene; or in several, where they show several.

    Scans that look alike as a whole are registered pair by pair. All poses are then decided on together: what
    the others contradict is dropped, what they confirm is kept, even where two scans alone could not tell.
    Components that pairs don't join are registered as unions. At last all scans are refined together on their
    surfaces.

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
        Rows of `scans` that are registered, and no others. By default all of 20 scans; beyond, each with those
        that look most like it.
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
        raise InputError("scans", f"{len(prepared)} that can be worked with", f"give two or more; {'; '.join(notes)}")
    within = {row: k for k, row in enumerate(rows)}
    if wanted is not None:
        wanted = [(within[one], within[other]) for one, other in wanted if one in within and other in within and one != other]
    with open_workers(prepared, threads, scheduler, keep, begin) as call:
        building = _Building(prepared, call, direction, effort, clock)
        building.register_pairs(wanted, None if moved is None else moved[rows])
        building.join()
        scene = building.finish()
    return _spread(scene, rows, given, called, notes)


class _Building:
    """A scene in the making."""

    def __init__(
        self, scans: Sequence[PreparedScan], call: CallEach, axis: FloatArray | None, effort: Effort, clock: StageClock
    ) -> None:
        self.scans, self.call, self.axis, self.effort, self.clock = scans, call, axis, effort, clock
        self.voxel = scans[0].voxel
        self.middles = np.array([scan.described.centroid for scan in scans])
        self.links: dict[tuple[int, int], Link] = {}
        self.chances: dict[tuple[int, int], float] = {}
        self.tried: set[tuple[int, int]] = set()
        self.decision = self._decide()

    def _decide(self) -> Decision:
        return decide(self.links, self.chances, self.middles, self.voxel)

    def _register(self, pairs: Sequence[tuple[int, int]], proposed: FloatArray | None = None) -> None:
        """Register pairs of scans, and decide anew."""
        starts = [None] * len(pairs) if proposed is None else [pose[None] for pose in proposed]
        tasks = [(pair, (self.axis, self.effort, start)) for pair, start in zip(pairs, starts, strict=True)]
        for pair, found in zip(pairs, self.call(link, tasks), strict=True):
            self.tried.add((max(pair), min(pair)))
            if found is not None:
                self.links[pair] = found
                self.chances[pair] = found.probability

    def register_pairs(self, wanted: list[tuple[int, int]] | None, odometry: FloatArray | None) -> None:
        """Register the pairs that are wanted, or those that may show the same."""
        count = len(self.scans)
        self.clock.start("pairs")
        if odometry is not None:
            self._follow_odometry(odometry)
        if wanted is not None:
            self._register([pair for pair in wanted if (max(pair), min(pair)) not in self.tried])
        elif count <= ALL_PAIRS:
            every = [(one, other) for one in range(count) for other in range(one)]
            self._register([pair for pair in every if pair not in self.tried])
        else:
            vectors = describe_scans(self.scans)
            similarity = vectors @ vectors.T
            self._register(choose_partners(similarity, self.tried, None, PARTNERS))
            while True:
                self.decision = self._decide()
                left = BUDGET * count - len(self.tried)
                more = choose_partners(similarity, self.tried, self.decision.labels.tolist(), 2)[: min(left, count)]
                if not more:
                    break
                self._register(more)
        self.decision = self._decide()

    def _follow_odometry(self, odometry: FloatArray) -> None:
        """Link neighbours from where odometry puts them, and by it where their surfaces don't tell."""
        pairs = [(row, row - 1) for row in range(1, len(self.scans))]
        moved = np.array([invert(odometry[target]) @ odometry[source] for source, target in pairs])
        self._register(pairs, moved)
        turn, shift = _ODOMETRY
        for pair, pose in zip(pairs, moved, strict=True):
            if pair not in self.links or not self.links[pair].is_accepted:
                spread = np.diag([turn**2] * 3 + [(shift * self.voxel) ** 2] * 3)
                self.links[pair] = Link(pose[None], np.array([SURE]), spread, 0.0, 0.0)
                self.chances[pair] = SURE

    def join(self) -> None:
        """Join components by the unions of their scans."""
        self.clock.start("joins")
        asked: set[tuple[int, ...]] = set()
        for _ in range(_JOINED):
            joins = [
                join
                for join in propose_joins(self.links, self.decision, self.middles, self.voxel)
                if (*join.around_source, -1, *join.around_target) not in asked
            ][: len(self.scans)]
            if not joins:
                return
            asked.update((*join.around_source, -1, *join.around_target) for join in joins)
            tasks = [task_of(join, self.decision, self.axis, self.effort) for join in joins]
            before = len(self.decision.components)
            unions = self.call(link_unions, tasks)
            rows = [
                (row, cross_tasks(joins[row], self.decision, found.pose))
                for row, found in enumerate(unions)
                if found is not None
            ]
            told = iter(self.call(confirm, [task for _, some in rows for task in some]))
            for row, some in rows:
                found = unions[row]
                agreeing = {pair: own for pair, start in some if (own := self._agreeing(pair, *start)) is not None}
                across = [_more_telling(next(told), agreeing.get(pair)) for pair, _ in some]
                evidence = weigh_join(found, across, list(agreeing.values()))
                if DEBUG is not None: DEBUG(self, joins[row], found, evidence)
                if evidence > 0:
                    self._add_join(joins[row].source, joins[row].target, found)
            self.decision = self._decide()
            if len(self.decision.components) == before:
                return

    def _agreeing(self, pair: tuple[int, int], expected: FloatArray) -> Link | None:
        """Return what the search of a pair has found, if that is an expected pose."""
        found = self.links.get(pair)
        if found is None and pair[::-1] in self.links:
            found = self.links[pair[::-1]].turned
        if found is None:
            return None
        error = squared_errors(
            found.pose[None], expected[None], found.covariance[None], self.middles[[pair[0]]], self.voxel
        )
        return found if error[0] < DISAGREES else None

    def _add_join(self, source: int, target: int, found: Link) -> None:
        pair = (source, target) if (target, source) not in self.links else (target, source)
        if pair != (source, target):
            found = found.turned
        self.links[pair], self.chances[pair] = found, max(found.probability, SURE)

    def finish(self) -> Scene:
        """Refine all scans together, and say what the scene consists of."""
        self.clock.start("refinement")
        agreeing = find_agreeing(self.links, self.decision, self.middles, self.voxel)
        kept = {pair: self.decision.kept.get(pair, 0.0) for pair in {*agreeing, *self.decision.kept}}
        laid: dict[tuple[int, int], Link] = {}
        for _ in range(_ROUNDS):
            pairs = find_overlapping(self.scans, self.decision, kept)
            laid = lay_on_each_other(self.call, pairs, self.decision, self.middles, self.voxel)
            for pair in kept:
                laid.setdefault(pair, self.links[pair])
            self.decision = self._settle(laid)
        return self._scene(laid, kept)

    def _settle(self, laid: dict[tuple[int, int], Link]) -> Decision:
        """Move the scans to where all pairs together put them."""
        rows = sorted(laid)
        graph = self._graph(rows, laid).optimize(start="given")
        return replace(self.decision, poses=anchor(graph.poses, self.decision.labels))

    def _graph(self, rows: list[tuple[int, int]], laid: dict[tuple[int, int], Link]) -> Any:
        pairs = np.array(rows, dtype=np.int64).reshape(-1, 2)
        measured = np.array([laid[pair].pose for pair in rows]).reshape(-1, 4, 4)
        spread = np.array([laid[pair].covariance for pair in rows]).reshape(-1, 6, 6)
        chances = np.full(len(rows), SURE)
        return graph_of(self.decision.poses, pairs, measured, spread, chances, self.middles, 0.02 * self.voxel)

    def _scene(self, laid: dict[tuple[int, int], Link], kept: dict[tuple[int, int], float]) -> Scene:
        graph = self._graph(sorted(laid), laid)
        count = len(self.scans)
        covariance = np.zeros((count, 6, 6))
        for row in range(count):
            change = adjoint(self.decision.poses[row])
            covariance[row] = change @ graph.covariance(row) @ change.T
        edges = self._edges(kept)
        return Scene(
            poses=self.decision.poses,
            components=self.decision.components,
            edges=edges,
            probability=self._probabilities(kept),
            covariance=covariance,
            names=[],
            scans=(),
            voxel=self.voxel,
            tried=len(self.tried),
            notes=(),
            seconds=self.clock.stop(),
        )

    def _edges(self, kept: dict[tuple[int, int], float]) -> list[Edge]:
        """Return what was accepted, and what the others bring back."""
        edges: list[Edge] = []
        labels = self.decision.labels
        for pair, found in sorted(self.links.items()):
            if not (pair in kept or found.is_accepted):
                continue
            together = labels[pair[0]] == labels[pair[1]]
            residual = np.nan
            if together:
                residual = float(errors_of([pair], self.links, self.decision, self.middles, self.voxel)[0] ** 0.5)
            reason = "" if pair in kept else "the other scans contradict it" if together else "one doubtful pose joins no components"
            edges.append(
                Edge(
                    *pair, found.pose, found.probability, found.covariance, found.fitness, found.target_fitness,
                    pair in kept, residual, reason,
                )
            )
        return edges

    def _probabilities(self, kept: dict[tuple[int, int], float]) -> FloatArray:
        """Return the weakest link on the best way from the first scan of its component to each scan."""
        rows = sorted(kept)
        pairs = np.array(rows, dtype=np.int64).reshape(-1, 2)
        if not rows:
            return np.ones(len(self.scans))
        posterior = weigh_by_triangles(
            pairs,
            np.array([self.links[pair].pose for pair in rows]),
            np.array([self.links[pair].covariance for pair in rows]),
            np.array([max(kept[pair], ACCEPTED) for pair in rows]),
            self.middles,
            self.voxel,
        )
        return self._widest(pairs, posterior)

    def _widest(self, pairs: Any, posterior: FloatArray) -> FloatArray:
        beside: list[list[tuple[int, float]]] = [[] for _ in self.scans]
        for (one, other), chance in zip(pairs.tolist(), posterior.tolist(), strict=True):
            beside[one].append((other, chance))
            beside[other].append((one, chance))
        reached = np.zeros(len(self.scans))
        roots = np.unique(self.decision.labels)
        reached[roots] = 1.0
        import heapq

        queue = [(-1.0, int(root)) for root in roots]
        while queue:
            chance, node = heapq.heappop(queue)
            for other, step in beside[node]:
                through = min(-chance, step)
                if through > reached[other]:
                    reached[other] = through
                    heapq.heappush(queue, (-through, other))
        return reached


def _more_telling(one: Link | None, other: Link | None) -> Link | None:
    return max((found for found in (one, other) if found is not None), key=lambda found: found.probability, default=None)


def _as_names(names: Sequence[str] | None, given: Sequence[Any]) -> list[str]:
    """Return what scans are called."""
    if names is None:
        import os

        return [os.path.basename(os.fspath(scan)) if isinstance(scan, str | os.PathLike) else f"scan {row}" for row, scan in enumerate(given)]
    return [str(name) for name in names]


def _as_odometry(odometry: ArrayLike, count: int) -> FloatArray:
    poses = np.asarray(odometry, dtype=np.float64)
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
            notes[row] = f"{names[row]} is left out: {error}"

    work_side_by_side(range(len(given)), check, workers)
    sizes = {row: cloud.whole.cloud.diagonal for row, cloud in enumerate(clouds) if cloud is not None}
    usual = float(np.median(list(sizes.values()))) if sizes else 0.0
    for row, size in sizes.items():
        if not usual / MAX_SIZE_RATIO**0.5 <= size <= usual * MAX_SIZE_RATIO**0.5:
            notes[row] = f"{names[row]} is left out: {size:.3g} across where the others are {usual:.3g}; scale it to their unit"
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
                notes[row] = f"{names[row]} is left out: {error}"

        work_side_by_side(range(len(given)), prepare, workers)
    return ready, [notes[row] for row in sorted(notes)]


def _spread(scene: Scene, rows: list[int], given: Sequence[Any], names: list[str], notes: list[str]) -> Scene:
    """Return the scene by the rows that were given, among which some were left out."""
    count = len(given)
    poses, covariance = np.full((count, 4, 4), np.nan), np.full((count, 6, 6), np.nan)
    probability = np.full(count, np.nan)
    poses[rows], covariance[rows], probability[rows] = scene.poses, scene.covariance, scene.probability
    alone = sum(len(part) == 1 for part in scene.components)
    found = [*notes]
    if len(scene.components) > 1:
        sizes = ", ".join(str(len(part)) for part in scene.components if len(part) > 1)
        several = f"{len(scene.components) - alone} scenes of {sizes} scans" if sizes else "no two scans hang together"
        found.append(several + (f", and {alone} scans that belong to none" if sizes and alone else ""))
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
    )
