"""Join components: what two scans don't share, two unions of scans may."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup import features
from cgroup._runtime.progress import ignore_progress
from cgroup.registration.judge import choose_apart
from cgroup.registration.prepare import Preparation
from cgroup.registration.scan import as_scan
from cgroup.rigid import apply, invert
from cgroup.scenes.links import link
from cgroup.types import PointCloud

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from cgroup.registration import PreparedScan
    from cgroup.registration.search import Effort
    from cgroup.scenes.decide import Decision
    from cgroup.scenes.links import Link
    from cgroup.types import FloatArray

IN_A_UNION = 6
"""Scans that are merged around one scan."""

_LEAST_CHANCE = 0.02
_FINEST = 1 / 3  # voxels between the points of a union, as its fine surface needs them
_PROPOSED = 3


class Join(NamedTuple):
    """Two scans of two components, the scans around each, and where the first may lie in the second's frame."""

    source: int
    target: int
    around_source: list[int]
    around_target: list[int]
    proposed: FloatArray


def merge_scans(scans: Sequence[PreparedScan], poses: FloatArray) -> PreparedScan:
    """Make one scan of several, with normals by frames; one alone stays as it is."""
    first = scans[0]
    if len(scans) == 1:
        return first
    moved = [apply(pose, scan.scan.cloud.points) for scan, pose in zip(scans, poses, strict=True)]
    thinned = features.voxel_downsample(np.concatenate(moved), _FINEST * first.voxel, threads=1).points
    shared = Preparation(first.voxel, first.front, 1)
    return shared.prepare(as_scan("scans", PointCloud(thinned)), None, ignore_progress, by_frames=True)


def link_unions(*scans_and_arguments: object) -> Link | None:
    """Register the union of the first scans to that of the others.

    Arguments are the scans, how many of them are merged into the source, their poses in the frames of the
    first scan of either union, the axis, the effort, and proposed poses of the one first scan on the other.
    """
    *scans, count, poses, axis, effort, proposed = scans_and_arguments
    return _link_unions(scans, count, poses, axis, effort, proposed)  # type: ignore[arg-type]


def _link_unions(
    scans: Sequence[PreparedScan],
    count: int,
    poses: FloatArray,
    axis: FloatArray | None,
    effort: Effort,
    proposed: FloatArray,
) -> Link | None:
    source, target = merge_scans(scans[:count], poses[:count]), merge_scans(scans[count:], poses[count:])
    return link(source, target, axis, effort, proposed if len(proposed) else None)


def propose_joins(
    links: Mapping[tuple[int, int], Link], decision: Decision, middles: FloatArray, voxel: float
) -> list[Join]:
    """Propose where components may lie in each other, the likeliest first: by poses that links leave open."""
    hypotheses: dict[tuple[int, int], list[tuple[float, tuple[int, int], FloatArray]]] = {}
    for (source, target), found in sorted(links.items()):
        one, other = int(decision.labels[source]), int(decision.labels[target])
        if one == other:
            continue
        for pose, chance in zip(found.poses, found.chances.tolist(), strict=True):
            if chance < _LEAST_CHANCE:
                continue
            between = decision.poses[target] @ pose @ invert(decision.poses[source])
            way = (source, target, between) if one > other else (target, source, invert(between))
            key = max(one, other), min(one, other)
            hypotheses.setdefault(key, []).append((chance, way[:2], way[2]))
    scored: list[tuple[float, Join]] = []
    for some in hypotheses.values():
        some.sort(key=lambda hypothesis: -hypothesis[0])
        poses = np.array([pose for _, _, pose in some])
        chances = np.array([chance for chance, _, _ in some])
        source, target = some[0][1]
        center = apply(decision.poses[source], middles[source][None])[0]
        apart = choose_apart(poses, center, voxel)
        turned = poses[:, :3, :3] @ center + poses[:, :3, 3]
        support = [float(chances[np.linalg.norm(turned - turned[row], axis=1) < 4 * voxel].sum()) for row in apart]
        best = [apart[k] for k in np.argsort([-value for value in support], kind="stable")[:_PROPOSED]]
        source, target = some[best[0]][1]
        back, onwards = invert(decision.poses[target]), decision.poses[source]
        proposed = np.array([back @ poses[row] @ onwards for row in best])
        around = [gather_around(scan, decision, middles) for scan in (source, target)]
        scored.append((max(support), Join(source, target, *around, proposed)))
    return [join for _, join in sorted(scored, key=lambda pair: -pair[0])]


def gather_around(scan: int, decision: Decision, middles: FloatArray) -> list[int]:
    """Rows of a scan and of those of its component that lie next to it."""
    rows = np.flatnonzero(decision.labels == decision.labels[scan])
    places = np.einsum("nij,nj->ni", decision.poses[rows, :3, :3], middles[rows]) + decision.poses[rows, :3, 3]
    away = np.linalg.norm(places - places[rows == scan], axis=1)
    away[rows == scan] = -1.0
    return rows[np.argsort(away, kind="stable")[:IN_A_UNION]].tolist()


def task_of(join: Join, decision: Decision, axis: FloatArray | None, effort: Effort) -> tuple[tuple[int, ...], tuple]:
    """Return the task of registering the two unions."""
    rows = (*join.around_source, *join.around_target)
    poses = np.array(
        [decision.between(row, first) for part in (join.around_source, join.around_target) for row in part for first in part[:1]]
    )
    return rows, (len(join.around_source), poses, axis, effort, join.proposed)
