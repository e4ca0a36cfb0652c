"""Build a scene: register pairs, select links together, join components, refine all scans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cgroup._runtime.progress import StageClock, ignore_progress
from cgroup.pose_graph import PoseGraph
from cgroup.registration import Effort, PreparedScan
from cgroup.registration.pairwise import Depth, FalseAccepts, count_false_accepts, is_accepted
from cgroup.rigid import invert
from cgroup.rigid.se3 import adjoint
from cgroup.scenes import settings
from cgroup.scenes.agreement import move_frames, weigh_by_triangles
from cgroup.scenes.decide import Decision, decide, follow_best, graph_of, weigh_residuals
from cgroup.scenes.join import Join, cross_tasks, link_unions, propose_joins, task_of, weigh_join
from cgroup.scenes.known import KnownPoses
from cgroup.scenes.links import Link, Pair, link, stack_links, weigh_pose
from cgroup.scenes.partners import choose_partners, describe_scans
from cgroup.scenes.refine import find_overlapping, refine_on_unions, refine_pairs
from cgroup.scenes.scene import Edge, Scene
from cgroup.scenes.workers import CallEach
from cgroup.types import FloatArray


class SceneBuilder:
    """Builds a scene in steps."""

    def __init__(
        self,
        scans: Sequence[PreparedScan],
        call: CallEach,
        axis: FloatArray | None,
        effort: Effort,
        clock: StageClock,
    ) -> None:
        self.scans, self._call, self.axis, self._clock = scans, call, axis, clock
        self._effort: Effort = effort
        self.known = KnownPoses({})
        self._voxel = scans[0].voxel
        self._middles = np.array([scan.scan.centroid for scan in scans])
        self._links: dict[Pair, Link] = {}
        self._chances: dict[Pair, float] = {}
        self._tried: set[Pair] = set()
        self._seen: set[Pair] = set()  # links that the surfaces do not reject
        self._firm: set[Pair] = set()  # links of joined unions, and those within them
        self._decision = self._decide()

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without workers and clock; `grown` makes its own."""
        return {**vars(self), "_call": None, "_clock": StageClock(ignore_progress)}

    def _decide(self) -> Decision:
        """Select consistent links, then reject those whose surfaces disagree, until none is rejected."""
        while True:
            decision = decide(self._links, self._chances, self._firm, self._middles, self._voxel)
            unseen = [pair for pair in decision.kept if pair not in self._seen]
            self._seen.update(unseen)
            weighed = self._call(weigh_pose, [(pair, (self._links[pair].pose,)) for pair in unseen])
            chances = [0.0 if found is None else found.probability for found in weighed]
            judged = zip(unseen, chances, strict=True)
            rejected = [pair for pair, chance in judged if chance < settings.REJECTED]
            if not rejected:
                return decision
            self._chances.update(dict.fromkeys(rejected, 0.0))

    # --- pairs -----------------------------------------------------------------------------------------

    def register_pairs(
        self,
        wanted: list[Pair] | None,
        odometry: FloatArray | None,
        known: Mapping[int, FloatArray],
    ) -> None:
        """Register the given pairs, or those of similar scans; link those of known poses."""
        count = len(self.scans)
        self._clock.start("pairs")
        if odometry is not None:
            self._follow_odometry(odometry)
        if wanted is None and count <= settings.ALL_PAIRS:
            wanted = [(one, other) for one in range(count) for other in range(one)]
        if wanted is None:
            self._register_alike()
        else:
            self._register([pair for pair in wanted if (max(pair), min(pair)) not in self._tried])
        self.known = KnownPoses(known)
        self.known.link(self._links, self._middles, self._voxel)
        self._chances = {pair: self._chances.get(pair, 1.0) for pair in self._links}
        self._chances |= dict.fromkeys(self.known.pairs, settings.LARGEST_CHANCE)
        self._seen |= self.known.pairs
        self._decision = self._decide()

    def _register_alike(self) -> None:
        """Register each scan with the most similar ones, then unlinked scans within the budget."""
        vectors = describe_scans(self.scans)
        similarity = vectors @ vectors.T
        wanted = choose_partners(similarity, self._tried, None, settings.FIRST_PARTNERS)
        while wanted:
            self._register(wanted)
            labels = self._decide().labels.tolist()
            left = settings.BUDGET * len(self.scans) - len(self._tried)
            wanted = choose_partners(similarity, self._tried, labels, settings.MORE_PARTNERS)[: max(left, 0)]

    def _register(self, pairs: Sequence[Pair]) -> None:
        """Register pairs at coarse voxels, then the unconnected ones with a chance at fine voxels."""
        if self._effort != "high":
            self._link(pairs, "first")
            labels = self._decide().labels
            unconnected = [pair for pair in pairs if labels[pair[0]] != labels[pair[1]]]
            pairs = [pair for pair in unconnected if self._chances.get(pair, 1.0) > settings.HOPELESS]
        self._link(pairs, self._effort)

    def _link(self, pairs: Sequence[Pair], effort: Depth, proposed: FloatArray | None = None) -> None:
        starts = [None] * len(pairs) if proposed is None else [pose[None] for pose in proposed]
        tasks = [(pair, (self.axis, effort, start)) for pair, start in zip(pairs, starts, strict=True)]
        for pair, found in zip(pairs, self._call(link, tasks), strict=True):
            self._tried.add((max(pair), min(pair)))
            if found is not None:
                self._links[pair], self._chances[pair] = found, found.probability

    def _follow_odometry(self, odometry: FloatArray) -> None:
        """Register neighbours from their odometry; link them by it if the surfaces are inconclusive."""
        pairs = [(row, row - 1) for row in range(1, len(self.scans))]
        moved = np.array([invert(odometry[target]) @ odometry[source] for source, target in pairs])
        self._link(pairs, self._effort, moved)
        spread = np.diag([settings.ODOMETRY_TURN**2] * 3 + [(settings.ODOMETRY_SHIFT * self._voxel) ** 2] * 3)
        for pair, pose in zip(pairs, moved, strict=True):
            found = self._links.get(pair)
            if found is None or not found.is_accepted:
                self._links[pair] = Link(pose[None], np.array([settings.FIRM]), spread, 0.0, 0.0)
                self._chances[pair] = settings.FIRM
                self._seen.add(pair)

    def grown(self, scan: PreparedScan, call: CallEach) -> SceneBuilder:
        """Return a new builder with a further scan, registered to the most similar ones."""
        clock = StageClock(ignore_progress)
        grown = SceneBuilder([*self.scans, scan], call, self.axis, self._effort, clock)
        grown._links, grown._chances = dict(self._links), dict(self._chances)
        grown._tried, grown._seen, grown._firm = set(self._tried), set(self._seen), set(self._firm)
        grown.known, row = self.known, len(self.scans)
        order = list(range(row))
        if row >= settings.ALL_PAIRS:
            vectors = describe_scans(grown.scans)
            order = np.argsort(-(vectors @ vectors[row])[:row], kind="stable").tolist()
            del order[2 * settings.FIRST_PARTNERS :]
        clock.start("pairs")
        grown._register([(row, other) for other in order])
        grown._decision = grown._decide()
        return grown

    @property
    def joins_last(self) -> bool:
        """Whether the last scan is connected to another."""
        labels = self._decision.labels
        return bool((labels[:-1] == labels[-1]).any())

    # --- joins -----------------------------------------------------------------------------------------

    def join(self) -> None:
        """Join components by the unions of their scans."""
        self._clock.start("joins")
        asked: set[tuple[tuple[int, ...], tuple[int, ...]]] = set()
        for _ in range(settings.JOIN_ROUNDS):
            proposed = propose_joins(self._links, self._decision, self._middles, self._voxel)
            joins = [join for join in proposed if join.parts not in asked][: len(self.scans)]
            asked.update(join.parts for join in joins)
            tasks = [task_of(join, self._decision, self.axis, self._effort) for join in joins]
            unions = self._call(link_unions, tasks)
            before = len(self._firm)
            for join, union in zip(joins, unions, strict=True):
                if union is not None and is_accepted(chance := self._weigh(join, union)):
                    self._add(join, union, chance)
            if len(self._firm) == before:
                return
            self._decision = self._decide()

    def _weigh(self, join: Join, union: Link) -> float:
        if not is_accepted(float(union.chances.sum())):  # which bounds it
            return 0.0
        tasks = [cross_tasks(join, self._decision, pose) for pose in union.poses]
        weighed = self._call(weigh_pose, [task for some in tasks for task in some])
        step = len(tasks[0])
        return weigh_join(union, [weighed[at : at + step] for at in range(0, len(weighed), step)])

    def _add(self, join: Join, union: Link, chance: float) -> None:
        """Link two scans by the pose of their unions, and fix the links of the unions."""
        pair = (join.source, join.target)
        if (join.target, join.source) in self._links:
            pair, union = (join.target, join.source), union.inverse
        self._links[pair], self._chances[pair] = union, chance
        self._seen.add(pair)
        within = (set(part) for part in join.parts)
        self._firm.update(
            (pair, *(each for part in within for each in self._decision.kept if part.issuperset(each)))
        )

    # --- refinement ------------------------------------------------------------------------------------

    def finish(self) -> Scene:
        """Join components, refine all scans together, and return the scene."""
        self.join()
        self._clock.start("refinement")
        labels = self._decision.labels
        self._decision = replace(self._decision, poses=self.known.settle(self._decision.poses, labels))
        residuals = weigh_residuals(self._links, self._decision, self._middles, self._voxel)
        agreeing = {pair for pair, error in residuals.items() if error < settings.DISAGREES}
        kept = self._weigh_kept(sorted({*agreeing, *self._decision.kept}))
        pairs = find_overlapping(self.scans, self._decision, kept)
        refined = refine_pairs(self._call, pairs, self._decision, self._middles, self._voxel)
        refined = {pair: self._links[pair] for pair in kept} | refined
        self._move(self._graph(refined))
        for _ in range(settings.UNION_ROUNDS):
            self._move(refine_on_unions(self._call, sorted(refined), self._decision, self._middles))
        graph, nodes, *_ = self.known.hold(self._graph(refined), self._middles)
        found, measured, *_ = stack_links(self._links, list(kept))
        _, _, least = follow_best(found, measured, np.array(list(kept.values())), len(self.scans))
        poses = self.known.restore(self._decision.poses, labels)
        changes = zip(nodes.tolist(), adjoint(move_frames(poses, self._middles)), strict=True)
        covariance = np.array([by @ graph.covariance(node) @ by.T for node, by in changes])
        return Scene(
            poses=poses,
            components=self._decision.components,
            edges=self._edges(kept),
            probability=least,
            covariance=covariance,
            names=[],
            scans=(),
            voxel=self._voxel,
            tried=len(self._tried),
            false_accepts=self._count_false_accepts(),
            notes=(),
            seconds=self._clock.stop(),
        )

    def _move(self, graph: PoseGraph) -> None:
        poses = self.known.solve(graph, self._middles)
        self._decision = replace(self._decision, poses=self.known.settle(poses, self._decision.labels))

    def _graph(self, refined: dict[Pair, Link]) -> PoseGraph:
        pairs, poses, spread, _ = stack_links(refined, sorted(refined))
        chances, own = np.full(len(pairs), settings.FIRM), self._decision.poses
        return graph_of(own, pairs, poses, spread, chances, self._middles, self._voxel, settings.EXACT)

    def _weigh_kept(self, kept: Sequence[Pair]) -> dict[Pair, float]:
        """Return the joint probability of each link that agrees with the scene."""
        pairs, poses, spread, overlap = stack_links(self._links, kept)
        prior = np.array([self._chances[pair] for pair in kept])
        found = weigh_by_triangles(pairs, poses, spread, prior, overlap, self._middles, self._voxel).tolist()
        decided = self._decision.kept
        return {pair: max(chance, decided.get(pair, 0.0)) for pair, chance in zip(kept, found, strict=True)}

    def _edges(self, kept: Mapping[Pair, float]) -> list[Edge]:
        """Return the accepted links, and the links that others confirm."""
        edges: list[Edge] = []
        residuals = weigh_residuals(self._links, self._decision, self._middles, self._voxel)
        for pair, found in sorted(self._links.items()):
            chance = kept.get(pair, found.probability)
            if not is_accepted(chance):
                continue
            residual = residuals[pair] ** 0.5 if pair in residuals else np.nan
            is_doubtful = np.isnan(residual) and chance < settings.FIRM
            reason = "doubtful poses join no components" if is_doubtful else "the other scans contradict it"
            state = (True, residual, "") if pair in kept else (False, residual, reason)
            shares = found.fitness, found.target_fitness
            edges.append(Edge(*pair, found.pose, chance, found.covariance, *shares, *state))
        return edges

    def _count_false_accepts(self) -> FalseAccepts:
        """Estimate the wrong ones among the links that are accepted from their two scans."""
        links = [found for found in self._links.values() if not np.isnan(found.decoy)]
        decoys = [is_accepted(found.decoy) for found in links]
        return count_false_accepts([found.is_accepted for found in links], decoys)
