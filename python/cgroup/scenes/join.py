"""Join components by registering unions of scans, which may overlap where single scans do not."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from cgroup import features
from cgroup.fronts.scan import as_scan
from cgroup.registration import Effort, PreparedScan
from cgroup.registration.pairwise import Preparation, choose_apart
from cgroup.rigid import apply, invert
from cgroup.scenes import settings
from cgroup.scenes.agreement import move_each
from cgroup.scenes.decide import Decision, log_odds
from cgroup.scenes.kept_links import Task
from cgroup.scenes.links import Link, Pair, link
from cgroup.types import FloatArray, PointCloud


class Join(NamedTuple):
    """Two scans of two components, the scans around each, and proposed poses of the first on the second."""

    source: int
    target: int
    around_source: list[int]
    around_target: list[int]
    proposed: FloatArray

    @property
    def parts(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The scans of both unions."""
        return tuple(self.around_source), tuple(self.around_target)


def merge_scans(scans: Sequence[PreparedScan], poses: FloatArray) -> PreparedScan:
    """Merge scans into one, with normals by frames; return a single scan unchanged."""
    first = scans[0]
    if len(scans) == 1:
        return first
    moved = [apply(pose, scan.thinned(settings.FINEST)) for scan, pose in zip(scans, poses, strict=True)]
    thinned = features.voxel_downsample(np.concatenate(moved), settings.FINEST * first.voxel, threads=1)
    shared = Preparation(first.voxel, first.front, 1)
    return shared.prepare(as_scan("scans", PointCloud(thinned.points)), None, by_frames=True)


def link_unions(*scans_and_arguments: Any) -> Link | None:  # noqa: ANN401 - scans, and what follows
    """Register the union of the first scans to that of the others.

    Arguments are the scans, how many of them are merged into the source, their poses in the frame of the
    first scan of either union, the axis, the effort, and proposed poses of the one first scan on the other.
    """
    *scans, count, poses, axis, effort, proposed = scans_and_arguments
    source, target = merge_scans(scans[:count], poses[:count]), merge_scans(scans[count:], poses[count:])
    return link(source, target, axis, effort, proposed)


def propose_joins(
    links: Mapping[Pair, Link], decision: Decision, middles: FloatArray, voxel: float
) -> list[Join]:
    """Propose poses between components from the unselected poses of links, the likeliest first."""
    hypotheses: dict[Pair, list[tuple[float, Pair, FloatArray]]] = {}
    sizes = np.bincount(decision.labels)
    for (source, target), found in sorted(links.items()):
        one, other = int(decision.labels[source]), int(decision.labels[target])
        if one == other or sizes[one] + sizes[other] == 2:  # two scans: no new evidence
            continue
        for pose, chance in zip(found.poses, found.chances.tolist(), strict=True):
            if chance < settings.LEAST_CHANCE:
                continue
            between = decision.poses[target] @ pose @ invert(decision.poses[source])
            way = (source, target, between) if one > other else (target, source, invert(between))
            key = max(one, other), min(one, other)
            hypotheses.setdefault(key, []).append((chance, way[:2], way[2]))
    scored = [_join_of(some, decision, middles, voxel) for some in hypotheses.values()]
    return [join for _, join in sorted(scored, key=lambda pair: -pair[0])]


def _join_of(
    hypotheses: list[tuple[float, Pair, FloatArray]],
    decision: Decision,
    middles: FloatArray,
    voxel: float,
) -> tuple[float, Join]:
    """Propose a join of two components from hypotheses: probabilities, pairs and poses."""
    some = sorted(hypotheses, key=lambda hypothesis: -hypothesis[0])
    poses = np.array([pose for _, _, pose in some])
    chances = np.array([chance for chance, _, _ in some])
    first = some[0][1][0]
    center = apply(decision.poses[first], middles[first][None])[0]
    support = _support(poses, chances, center, voxel)
    apart = choose_apart(poses, center, voxel)
    best = sorted(apart, key=lambda row: -support[row])[: settings.PROPOSED]
    source, target = some[best[0]][1]
    back, onwards = invert(decision.poses[target]), decision.poses[source]
    proposed = np.array([back @ poses[row] @ onwards for row in best])
    around, beside = (gather_around(scan, decision, middles) for scan in (source, target))
    return float(support[best[0]]), Join(source, target, around, beside, proposed)


def _support(poses: FloatArray, chances: FloatArray, center: FloatArray, voxel: float) -> FloatArray:
    """Return the sum of probabilities of the poses near each pose; agreeing poses count more."""
    landed = poses[:, :3, :3] @ center + poses[:, :3, 3]
    near = np.linalg.norm(landed[:, None] - landed, axis=2) < settings.NEAR * voxel
    turns = np.einsum("nij,mij->nm", poses[:, :3, :3], poses[:, :3, :3])
    alike = near & (turns > 1 + 2 * np.cos(settings.ALIKE))
    return alike @ (chances + settings.AGREEING) - settings.AGREEING


def gather_around(scan: int, decision: Decision, middles: FloatArray) -> list[int]:
    """Return the rows of a scan and of those next to it in its component."""
    rows = np.flatnonzero(decision.labels == decision.labels[scan])
    places = move_each(decision.poses[rows], middles[rows])
    away = np.linalg.norm(places - places[rows == scan], axis=1)
    away[rows == scan] = -1.0
    return rows[np.argsort(away, kind="stable")[: settings.IN_A_UNION]].tolist()


def task_of(join: Join, decision: Decision, axis: FloatArray | None, effort: Effort) -> Task:
    """Return the task that registers the two unions."""
    parts = join.around_source, join.around_target
    poses = np.array([decision.between(row, part[0]) for part in parts for row in part])
    return (*parts[0], *parts[1]), (len(parts[0]), poses, axis, effort, join.proposed)


def cross_tasks(join: Join, decision: Decision, pose: FloatArray) -> list[Task]:
    """Return the tasks that evaluate each pair across a join at its pose."""
    tasks: list[Task] = []
    for source, target in itertools.product(join.around_source, join.around_target):
        expected = decision.between(join.target, target) @ pose @ decision.between(source, join.source)
        tasks.append(((source, target), (expected,)))
    return tasks


def weigh_join(union: Link, across: Sequence[Sequence[Link | None]]) -> float:
    """Return the probability that the best pose of two unions is correct.

    It is bounded by the total probability of all poses of the unions. A pose that fits no pair is no rival.
    Evidence of pairs is not independent: their unions are the same surfaces. Pairs that overlap but
    do not fit under the best pose lower the probability. `across` has the evidence of each pair under each
    pose of the union.
    """
    known = [[found for found in some if found is not None] for some in across]
    best = np.array([max((found.probability for found in some), default=0.0) for some in known])
    weights = union.chances * np.maximum(best, settings.LEAST_CHANCE)
    among = union.chances.sum() * weights[0] / weights.sum()
    fits = [(one.overlap, _bounded_odds(one.probability, settings.MOST_NATS_AGAINST)) for one in known[0]]
    against = sum(nats if overlap >= settings.TELLING else max(nats, 0.0) for overlap, nats in fits)
    nats = _bounded_odds(among, settings.MOST_NATS_OF_UNIONS) + min(against, 0.0)
    return float(1.0 / (1.0 + np.exp(-nats)))


def _bounded_odds(probability: float, most: float) -> float:
    return float(np.clip(log_odds(np.array(probability)), -most, most))
