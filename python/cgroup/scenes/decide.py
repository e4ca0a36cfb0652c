"""Select the consistent poses between scans, and the components that they connect."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from cgroup.pose_graph import PoseGraph
from cgroup.registration.pairwise import ACCEPTED
from cgroup.rigid import invert
from cgroup.rigid.se3 import adjoint, information_of
from cgroup.scenes import settings
from cgroup.scenes.agreement import center_links, move_frames, squared_errors, weigh_by_triangles
from cgroup.scenes.links import Link, Pair, stack_links
from cgroup.types import BoolArray, FloatArray, IndexArray


@dataclass(frozen=True, eq=False)
class Decision:
    """Poses of scans in the frames of their components, and the selected links."""

    poses: FloatArray  # (N,4,4), scan to component
    labels: IndexArray  # (N,), component of each scan, the least row in it
    kept: dict[Pair, float]  # probability of each selected link, by (source, target)

    @property
    def components(self) -> list[list[int]]:
        """Rows of the scans of each component, the largest first."""
        parts = [np.flatnonzero(self.labels == label).tolist() for label in np.unique(self.labels)]
        return sorted(parts, key=lambda part: (-len(part), part[0]))

    def between(self, source: int, target: int) -> FloatArray:
        """Return the pose of a scan in the frame of another of its component."""
        return invert(self.poses[target]) @ self.poses[source]


def decide(
    links: Mapping[Pair, Link],
    chances: Mapping[Pair, float],
    firm: Collection[Pair],
    middles: FloatArray,
    voxel: float,
) -> Decision:
    """Select links among those that are probable alone.

    Triangles reweight the links, the most probable ones give initial poses, graduated non-convexity rejects
    inconsistent links, and a single doubtful link does not connect components.
    """
    count = len(middles)
    rows = [pair for pair in sorted(links) if chances[pair] >= ACCEPTED]
    pairs, measured, spread, overlap = stack_links(links, rows)
    prior = np.array([chances[pair] for pair in rows])
    posterior = weigh_by_triangles(pairs, measured, spread, prior, overlap, middles, voxel)
    likely = posterior >= ACCEPTED
    start, _, _ = follow_best(pairs[likely], measured[likely], posterior[likely], count)
    graph = graph_of(start, pairs, measured, spread, posterior, middles, voxel)
    kept = graph.optimize(robust=True, start="given").kept & likely
    kept = drop_contradicted(pairs, kept, prior, posterior, count)
    is_firm = (prior >= settings.FIRM) | np.array([pair in firm for pair in rows], dtype=bool)
    kept[kept] = drop_weak_bridges(pairs[kept], prior[kept], is_firm[kept], count)
    poses, labels, _ = follow_best(pairs[kept], measured[kept], posterior[kept], count)
    graph = graph_of(poses, pairs[kept], measured[kept], spread[kept], posterior[kept], middles, voxel)
    solved = move_frames(graph.optimize(start="given").poses, -middles)
    poses = np.array([invert(solved[label]) @ pose for label, pose in zip(labels, solved, strict=True)])
    selected = {rows[row]: float(posterior[row]) for row in np.flatnonzero(kept)}
    return Decision(poses, labels, selected)


def graph_of(
    poses: FloatArray,
    pairs: IndexArray,
    measured: FloatArray,
    spread: FloatArray,
    chances: FloatArray,
    middles: FloatArray,
    voxel: float,
    share: float = 1.0,
) -> PoseGraph:
    """Return a pose graph of links; a part of the least deviations is added to their covariances.

    The frames of its nodes are at the middles of the scans, which may be far from the origin.
    """
    turn, shift = share * settings.LEAST_TURN, share * settings.LEAST_SHIFT * voxel
    landed = move_frames(measured, middles[pairs[:, 0]])
    change = adjoint(np.asarray(np.linalg.inv(landed), np.float64))  # to motions in the frame of the source
    floor = np.diag([turn**2] * 3 + [shift**2] * 3)
    return PoseGraph(
        move_frames(poses, middles),
        pairs[:, ::-1],
        center_links(pairs, measured, middles),
        information_of(change @ spread @ change.transpose(0, 2, 1) + floor),
        np.minimum(chances, settings.LARGEST_CHANCE),
    )


def follow_best(
    pairs: IndexArray, measured: FloatArray, chances: FloatArray, count: int
) -> tuple[FloatArray, IndexArray, FloatArray]:
    """Follow the most probable links, the maximum spanning tree of each component.

    Return the poses of the scans in the frames of their components, (N,4,4); the component of each, the least
    row in it, (N,); and the chance of the least probable link between each and the first of its component.
    """
    poses, labels, least = np.tile(np.eye(4), (count, 1, 1)), np.arange(count), np.ones(count)
    for row in np.argsort(-chances, kind="stable").tolist():
        source, target = pairs[row].tolist()
        if labels[source] == labels[target]:
            continue
        placed = poses[target] @ measured[row] @ invert(poses[source])  # source's component into target's
        one, other = labels[source], labels[target]
        moved, change = (one, placed) if one > other else (other, invert(placed))
        members = labels == moved
        poses[members] = change @ poses[members]
        labels[members] = min(one, other)
        least[members] = chances[row]
    return poses, labels, least


def drop_contradicted(
    pairs: IndexArray, kept: BoolArray, prior: FloatArray, posterior: FloatArray, count: int
) -> BoolArray:
    """Drop all links of scans whose rejected links outweigh the evidence for their kept ones."""
    balance = np.where(kept, np.minimum(log_odds(posterior), settings.MOST_NATS), -log_odds(prior))
    sums = np.bincount(pairs.ravel(), np.repeat(balance, 2), count)
    return kept & (sums[pairs] > 0).all(axis=1)


def drop_weak_bridges(pairs: IndexArray, prior: FloatArray, firm: BoolArray, count: int) -> BoolArray:
    """Return the mask of links that do not connect components by doubtful poses only.

    Poses that are wrong for the same reason, such as those of a shape on its mirror image, agree with each
    other. So the links between two parts must together be as sure as one that is sure by itself, counting
    only the surest link of each scan. Any link connects two single scans; two links connect a single scan to
    a part, if there is only one such part.
    """
    labels, nats = np.arange(count), np.where(firm, np.inf, log_odds(prior))
    while True:
        sums = _sum_independent(np.sort(labels[pairs], axis=1), pairs, nats)
        parts = max(sums, key=lambda both: sums[both], default=None)
        if parts is None or sums[parts] < log_odds(np.array(settings.FIRM)):
            break
        labels[labels == parts[1]] = parts[0]
    single = np.bincount(labels, minlength=count)[labels] == 1
    for row in np.argsort(-prior, kind="stable").tolist():
        one, other = pairs[row]
        if single[one] and single[other]:
            labels[max(one, other)] = min(one, other)
            single[[one, other]] = False
    for scan in np.flatnonzero(single).tolist():
        beside = pairs[(pairs == scan).any(axis=1)].sum(axis=1) - scan
        parts, links = np.unique(labels[beside], return_counts=True)
        if (links > 1).sum() == 1:
            labels[scan] = parts[links > 1][0]
    return labels[pairs[:, 0]] == labels[pairs[:, 1]]


def _sum_independent(sides: IndexArray, pairs: IndexArray, nats: FloatArray) -> dict[Pair, float]:
    """Sum the nats of links without a common scan between each two parts, the most probable first."""
    sums: dict[Pair, float] = {}
    used: set[tuple[int, int, int]] = set()
    for row in np.argsort(-nats, kind="stable").tolist():
        least, most = sides[row].tolist()
        ends = {(least, most, scan) for scan in pairs[row].tolist()}
        if least != most and not ends & used:
            used |= ends
            sums[least, most] = sums.get((least, most), 0.0) + float(nats[row])
    return sums


def log_odds(chances: FloatArray) -> FloatArray:
    """Return the log-odds of probabilities, clipped away from 0 and 1."""
    bounded = np.clip(chances, 1 - settings.LARGEST_CHANCE, settings.LARGEST_CHANCE)
    return np.log(bounded / (1 - bounded))


def weigh_residuals(
    links: Mapping[Pair, Link], decision: Decision, middles: FloatArray, voxel: float
) -> dict[Pair, float]:
    """Return the squared weighted distances of the links within components from the scene's poses."""
    rows = [pair for pair in sorted(links) if decision.labels[pair[0]] == decision.labels[pair[1]]]
    if not rows:
        return {}
    pairs, found, spread, _ = stack_links(links, rows)
    expected = np.array([decision.between(*pair) for pair in rows])
    errors = squared_errors(found, expected, spread, middles[pairs[:, 0]], voxel)
    return dict(zip(rows, errors.tolist(), strict=True))
