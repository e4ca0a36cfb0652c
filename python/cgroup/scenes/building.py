"""A scene in the making: pairs are registered, decided on together, joined and refined."""

from __future__ import annotations

import heapq
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cgroup._runtime.progress import StageClock, ignore_progress
from cgroup.registration.judge import ACCEPTED, SURE
from cgroup.registration.motions import adjoint
from cgroup.rigid import invert
from cgroup.scenes.agreement import DISAGREES, SHIFT, TURN, squared_errors, weigh_by_triangles
from cgroup.scenes.decide import Decision, anchor, decide, graph_of, weigh_residuals
from cgroup.scenes.join import Join, cross_tasks, link_unions, propose_joins, task_of, weigh_join
from cgroup.scenes.links import Link, link, weigh_pose
from cgroup.scenes.partners import choose_partners, describe_scans
from cgroup.scenes.refine import find_overlapping, lay_on_each_other, lay_on_unions
from cgroup.scenes.scene import Edge, Scene

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cgroup.registration import PreparedScan
    from cgroup.registration.search import Effort
    from cgroup.scenes.pose_graph import PoseGraph
    from cgroup.scenes.workers import CallEach
    from cgroup.types import FloatArray

ALL_PAIRS = 20
"""Scans up to which every pair is tried."""

PARTNERS, BUDGET = 6, 8
"""Partners that each scan is tried with at first, and pairs per scan that are tried at most."""

_MORE = 2  # partners of each scan that are tried in each further round
_JOINS, _UNIONS = 3, 3  # rounds of joining components, and of laying each scan on the others
_TURN, _SHIFT = np.radians(3.0), 2.0  # deviations of odometry: radians, voxels
_DENIED = 0.05  # probability of a pose on the surfaces, below which it is not kept whatever its link says
_EXACT = 0.2  # part of the deviation of links that is left where scans were refined together


class Building:
    """A scene in the making."""

    def __init__(
        self,
        scans: Sequence[PreparedScan],
        call: CallEach,
        axis: FloatArray | None,
        effort: Effort,
        clock: StageClock,
    ) -> None:
        self.scans, self._call, self._axis, self._clock = scans, call, axis, clock
        self._effort: Effort = effort
        self._voxel = scans[0].voxel
        self._middles = np.array([scan.scan.centroid for scan in scans])
        self._links: dict[tuple[int, int], Link] = {}
        self._chances: dict[tuple[int, int], float] = {}
        self._tried: set[tuple[int, int]] = set()
        self._seen: set[tuple[int, int]] = set()  # links that the surfaces do not deny
        self._decision = self._decide()

    def _decide(self) -> Decision:
        """Decide on all links; those that are kept, but that the surfaces deny, are left out."""
        while True:
            decision = decide(self._links, self._chances, self._middles, self._voxel)
            unseen = [pair for pair in decision.kept if pair not in self._seen]
            self._seen.update(unseen)
            told = self._call(weigh_pose, [(pair, (self._links[pair].pose,)) for pair in unseen])
            denied = [
                pair
                for pair, found in zip(unseen, told, strict=True)
                if found is None or found.probability < _DENIED
            ]
            if not denied:
                return decision
            self._chances.update(dict.fromkeys(denied, 0.0))

    # --- pairs -----------------------------------------------------------------------------------------

    def register_pairs(self, wanted: list[tuple[int, int]] | None, odometry: FloatArray | None) -> None:
        """Register the pairs that are wanted, or those that may show the same."""
        count = len(self.scans)
        self._clock.start("pairs")
        if odometry is not None:
            self._follow_odometry(odometry)
        if wanted is None and count <= ALL_PAIRS:
            wanted = [(one, other) for one in range(count) for other in range(one)]
        if wanted is None:
            self._register_alike()
        else:
            self._register([pair for pair in wanted if (max(pair), min(pair)) not in self._tried])
        self._decision = self._decide()

    def _register_alike(self) -> None:
        """Register each scan with those most like it; then what is not linked yet, until a budget ends."""
        vectors = describe_scans(self.scans)
        similarity = vectors @ vectors.T
        wanted = choose_partners(similarity, self._tried, None, PARTNERS)
        while wanted:
            self._register(wanted)
            labels = self._decide().labels.tolist()
            left = BUDGET * len(self.scans) - len(self._tried)
            wanted = choose_partners(similarity, self._tried, labels, _MORE)[: max(left, 0)]

    def _register(self, pairs: Sequence[tuple[int, int]], proposed: FloatArray | None = None) -> None:
        starts = [None] * len(pairs) if proposed is None else [pose[None] for pose in proposed]
        tasks = [(pair, (self._axis, self._effort, start)) for pair, start in zip(pairs, starts, strict=True)]
        for pair, found in zip(pairs, self._call(link, tasks), strict=True):
            self._tried.add((max(pair), min(pair)))
            if found is not None:
                self._links[pair], self._chances[pair] = found, found.probability

    def _follow_odometry(self, odometry: FloatArray) -> None:
        """Register neighbours from where odometry puts them; link them by it where surfaces don't tell."""
        pairs = [(row, row - 1) for row in range(1, len(self.scans))]
        moved = np.array([invert(odometry[target]) @ odometry[source] for source, target in pairs])
        self._register(pairs, moved)
        spread = np.diag([_TURN**2] * 3 + [(_SHIFT * self._voxel) ** 2] * 3)
        for pair, pose in zip(pairs, moved, strict=True):
            found = self._links.get(pair)
            if found is None or not found.is_accepted:
                self._links[pair] = Link(pose[None], np.array([SURE]), spread, 0.0, 0.0)
                self._chances[pair] = SURE
                self._seen.add(pair)

    def grown(self, scan: PreparedScan, call: CallEach) -> Building:
        """Return a new one with one more scan, registered with those most like it."""
        clock = StageClock(ignore_progress)
        grown = Building([*self.scans, scan], call, self._axis, self._effort, clock)
        grown._links, grown._chances = dict(self._links), dict(self._chances)
        grown._tried, grown._seen = set(self._tried), set(self._seen)
        row = len(self.scans)
        order = list(range(row))
        if row >= ALL_PAIRS:
            vectors = describe_scans(grown.scans)
            order = np.argsort(-(vectors @ vectors[row])[:row], kind="stable")[: 2 * PARTNERS].tolist()
        clock.start("pairs")
        grown._register([(row, other) for other in order])
        grown._decision = grown._decide()
        return grown

    # --- joins -----------------------------------------------------------------------------------------

    def _join(self) -> None:
        """Join components by the unions of their scans."""
        self._clock.start("joins")
        asked: set[tuple[tuple[int, ...], tuple[int, ...]]] = set()
        for _ in range(_JOINS):
            proposed = propose_joins(self._links, self._decision, self._middles, self._voxel)
            joins = [join for join in proposed if join.parts not in asked][: len(self.scans)]
            asked.update(join.parts for join in joins)
            tasks = [task_of(join, self._decision, self._axis, self._effort) for join in joins]
            unions = self._call(link_unions, tasks)
            before = len(self._chances)
            for join, union in zip(joins, unions, strict=True):
                if union is not None and self._is_confirmed(join, union):
                    self._add(join.source, join.target, union)
            if joins and len(self._decision.components) > 1:
                self._decision = self._decide()
            if not joins or len(self._chances) == before:
                return

    def _is_confirmed(self, join: Join, union: Link) -> bool:
        """Whether the pairs across a join speak for it."""
        tasks = cross_tasks(join, self._decision, union.pose)
        told = self._call(weigh_pose, tasks)
        agreeing = [self._agreeing(pair, *expected) for pair, expected in tasks]
        across = [
            max(
                (one for one in both if one is not None),
                key=lambda one: one.probability,
                default=None,
            )
            for both in zip(told, agreeing, strict=True)
        ]
        return weigh_join(union, across, [one for one in agreeing if one is not None]) > 0

    def _agreeing(self, pair: tuple[int, int], expected: FloatArray) -> Link | None:
        """Return what the search of a pair has found, if that is an expected pose."""
        found = self._links.get(pair)
        back = self._links.get((pair[1], pair[0]))
        if found is None and back is not None:
            found = back.turned
        if found is None:
            return None
        error = squared_errors(
            found.pose[None], expected[None], found.covariance[None], self._middles[[pair[0]]], self._voxel
        )
        return found if error[0] < DISAGREES else None

    def _add(self, source: int, target: int, union: Link) -> None:
        """Link two scans by the pose of their unions."""
        pair = (source, target)
        if (target, source) in self._links:
            pair, union = (target, source), union.turned
        self._links[pair], self._chances[pair] = union, max(union.probability, SURE)
        self._seen.add(pair)

    # --- refinement ------------------------------------------------------------------------------------

    def finish(self) -> Scene:
        """Join components, refine all scans together, and say what the scene consists of."""
        self._join()
        self._clock.start("refinement")
        agreeing = {pair for pair, error in self._residuals().items() if error < DISAGREES}
        kept = {pair: self._decision.kept.get(pair, 0.0) for pair in {*agreeing, *self._decision.kept}}
        pairs = find_overlapping(self.scans, self._decision, kept)
        laid = lay_on_each_other(self._call, pairs, self._decision, self._middles, self._voxel)
        laid = {pair: self._links[pair] for pair in kept} | laid
        self._move(self._graph(laid))
        for _ in range(_UNIONS):
            self._move(lay_on_unions(self._call, sorted(laid), self._decision))
        graph = self._graph(laid)
        covariance = np.zeros((len(self.scans), 6, 6))
        for row, pose in enumerate(self._decision.poses):
            change = adjoint(pose)
            covariance[row] = change @ graph.covariance(row) @ change.T
        return Scene(
            poses=self._decision.poses,
            components=self._decision.components,
            edges=self._edges(kept),
            probability=self._probabilities(kept),
            covariance=covariance,
            names=[],
            scans=(),
            voxel=self._voxel,
            tried=len(self._tried),
            notes=(),
            seconds=self._clock.stop(),
        )

    def _residuals(self) -> dict[tuple[int, int], float]:
        return weigh_residuals(self._links, self._decision, self._middles, self._voxel)

    def _move(self, graph: PoseGraph) -> None:
        """Move the scans to where a graph puts them."""
        poses = anchor(graph.optimize(start="given").poses, self._decision.labels)
        self._decision = replace(self._decision, poses=poses)

    def _graph(self, laid: dict[tuple[int, int], Link]) -> PoseGraph:
        rows = sorted(laid)
        return graph_of(
            self._decision.poses,
            np.array(rows, dtype=np.int64).reshape(-1, 2),
            np.array([laid[pair].pose for pair in rows]).reshape(-1, 4, 4),
            np.array([laid[pair].covariance for pair in rows]).reshape(-1, 6, 6),
            np.full(len(rows), SURE),
            self._middles,
            (_EXACT * TURN, _EXACT * SHIFT * self._voxel),
        )

    def _edges(self, kept: dict[tuple[int, int], float]) -> list[Edge]:
        """Return what was accepted, and what the others bring back."""
        edges: list[Edge] = []
        residuals = self._residuals()
        for pair, found in sorted(self._links.items()):
            if pair not in kept and not found.is_accepted:
                continue
            residual, reason = np.nan, "doubtful poses alone don't join components"
            if pair in residuals:
                residual, reason = residuals[pair] ** 0.5, "the other scans contradict it"
            edges.append(
                Edge(
                    *pair,
                    found.pose,
                    found.probability,
                    found.covariance,
                    found.fitness,
                    found.target_fitness,
                    pair in kept,
                    residual,
                    "" if pair in kept else reason,
                )
            )
        return edges

    def _probabilities(self, kept: dict[tuple[int, int], float]) -> FloatArray:
        """Return the least probable link on the best way from the first scan of its component to each."""
        rows = sorted(kept)
        posterior = weigh_by_triangles(
            np.array(rows, dtype=np.int64).reshape(-1, 2),
            np.array([self._links[pair].pose for pair in rows]).reshape(-1, 4, 4),
            np.array([self._links[pair].covariance for pair in rows]).reshape(-1, 6, 6),
            np.array([max(kept[pair], ACCEPTED) for pair in rows]),
            self._middles,
            self._voxel,
        )
        beside: list[list[tuple[int, float]]] = [[] for _ in self.scans]
        for (one, other), chance in zip(rows, posterior.tolist(), strict=True):
            beside[one].append((other, chance))
            beside[other].append((one, chance))
        reached = np.zeros(len(self.scans))
        first = np.unique(self._decision.labels).tolist()
        reached[first] = 1.0
        waiting = [(-1.0, row) for row in first]
        while waiting:
            chance, row = heapq.heappop(waiting)
            for other, step in beside[row]:
                through = min(-chance, step)
                if through > reached[other]:
                    reached[other] = through
                    heapq.heappush(waiting, (-through, other))
        return reached
