"""A scene in the making: pairs are registered, decided on together, joined and refined."""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cgroup._runtime.progress import StageClock, ignore_progress
from cgroup.registration import PreparedScan
from cgroup.registration.judge import SURE, is_accepted
from cgroup.registration.motions import adjoint
from cgroup.registration.search import Effort
from cgroup.rigid import invert
from cgroup.scenes.agreement import DISAGREES, SHIFT, TURN, weigh_by_triangles
from cgroup.scenes.decide import FIRM, Decision, anchor, decide, graph_of, weigh_residuals
from cgroup.scenes.join import Join, cross_tasks, link_unions, propose_joins, task_of, weigh_join
from cgroup.scenes.links import Link, link, weigh_pose
from cgroup.scenes.partners import choose_partners, describe_scans
from cgroup.scenes.pose_graph import PoseGraph
from cgroup.scenes.refine import find_overlapping, lay_on_each_other, lay_on_unions
from cgroup.scenes.scene import Edge, Scene
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
        self._firm: set[tuple[int, int]] = set()  # links of unions that were joined, and those within them
        self._decision = self._decide()

    def _decide(self) -> Decision:
        """Decide on all links; those that are kept, but that the surfaces deny, are left out."""
        while True:
            decision = decide(self._links, self._chances, self._firm, self._middles, self._voxel)
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
        grown._tried, grown._seen, grown._firm = set(self._tried), set(self._seen), set(self._firm)
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
            before = len(self._firm)
            for join, union in zip(joins, unions, strict=True):
                if union is not None and is_accepted(chance := self._weigh(join, union)):
                    self._add(join, union, chance)
            if len(self._firm) == before:
                return
            self._decision = self._decide()

    def _weigh(self, join: Join, union: Link) -> float:
        """Return the probability of a join."""
        if not is_accepted(float(union.chances.sum())):  # which bounds it
            return 0.0
        tasks = [cross_tasks(join, self._decision, pose) for pose in union.poses]
        told = self._call(weigh_pose, [task for some in tasks for task in some])
        step = len(tasks[0])
        return weigh_join(union, [told[at : at + step] for at in range(0, len(told), step)])

    def _add(self, join: Join, union: Link, chance: float) -> None:
        """Link two scans by the pose of their unions, which hold together from now on."""
        pair = (join.source, join.target)
        if (join.target, join.source) in self._links:
            pair, union = (join.target, join.source), union.turned
        self._links[pair], self._chances[pair] = union, chance
        self._seen.add(pair)
        within = (set(part) for part in join.parts)
        self._firm.update(
            (pair, *(each for part in within for each in self._decision.kept if part.issuperset(each)))
        )

    # --- refinement ------------------------------------------------------------------------------------

    def finish(self) -> Scene:
        """Join components, refine all scans together, and say what the scene consists of."""
        self._join()
        self._clock.start("refinement")
        agreeing = {pair for pair, error in self._residuals().items() if error < DISAGREES}
        kept = self._weigh_kept(sorted({*agreeing, *self._decision.kept}))
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

    def _weigh_kept(self, kept: Sequence[tuple[int, int]]) -> dict[tuple[int, int], float]:
        """Return the probability of each link that agrees with the scene, as all of them together tell."""
        posterior = weigh_by_triangles(
            np.array(kept, dtype=np.int64).reshape(-1, 2),
            np.array([self._links[pair].pose for pair in kept]).reshape(-1, 4, 4),
            np.array([self._links[pair].covariance for pair in kept]).reshape(-1, 6, 6),
            np.array([self._chances[pair] for pair in kept]),
            np.array([self._links[pair].overlap for pair in kept]),
            self._middles,
            self._voxel,
        )
        decided = self._decision.kept
        return {
            pair: max(chance, decided.get(pair, 0.0))
            for pair, chance in zip(kept, posterior.tolist(), strict=True)
        }

    def _edges(self, kept: Mapping[tuple[int, int], float]) -> list[Edge]:
        """Return what was accepted, and what the others bring back."""
        edges: list[Edge] = []
        residuals = self._residuals()
        for pair, found in sorted(self._links.items()):
            chance = kept.get(pair, found.probability)
            if not is_accepted(chance):
                continue
            residual = residuals[pair] ** 0.5 if pair in residuals else np.nan
            is_doubtful = np.isnan(residual) and chance < FIRM
            reason = "doubtful poses join no components" if is_doubtful else "the other scans contradict it"
            edges.append(
                Edge(
                    *pair,
                    found.pose,
                    chance,
                    found.covariance,
                    found.fitness,
                    found.target_fitness,
                    pair in kept,
                    residual,
                    "" if pair in kept else reason,
                )
            )
        return edges

    def _probabilities(self, kept: Mapping[tuple[int, int], float]) -> FloatArray:
        """Return the least probable link on the best way from the first scan of its component to each."""
        beside: list[list[tuple[int, float]]] = [[] for _ in self.scans]
        for (one, other), chance in kept.items():
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
