"""Refine all scans of a scene together, on their surfaces."""

import itertools
from collections import Counter, defaultdict
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from cgroup.errors import InputError
from cgroup.pose_graph import PoseGraph
from cgroup.pose_graph.files import singular
from cgroup.registration import PreparedScan
from cgroup.registration.pairwise import FINE
from cgroup.rigid import apply
from cgroup.rigid.se3 import about
from cgroup.scenes import settings
from cgroup.scenes.agreement import center_links, move_frames, squared_errors
from cgroup.scenes.decide import Decision
from cgroup.scenes.links import Link, Pair, confirm, stack_links
from cgroup.scenes.workers import CallEach
from cgroup.types import FloatArray
from cgroup.verification import FineSurface, align


def find_overlapping(scans: Sequence[PreparedScan], decision: Decision, kept: Collection[Pair]) -> list[Pair]:
    """Return the pairs of largest overlap of each scan, and the kept ones."""
    holders: dict[tuple[int, ...], list[int]] = defaultdict(list)
    sizes = np.zeros(len(scans))
    for row, scan in enumerate(scans):
        placed = apply(decision.poses[row], scan.points)
        cells = np.unique(np.floor(placed / (settings.CELL * scan.voxel)).astype(np.int64), axis=0)
        sizes[row] = len(cells)
        label = int(decision.labels[row])
        for cell in cells.tolist():
            holders[(label, *cell)].append(row)
    shared: Counter[Pair] = Counter()
    for rows in holders.values():
        shared.update((one, other) for k, one in enumerate(rows) for other in rows[:k])
    partners: dict[int, list[tuple[float, int]]] = defaultdict(list)
    for (one, other), cells in shared.items():
        share = cells / min(sizes[one], sizes[other])
        if share >= settings.LEAST_SHARED:
            partners[one].append((share, other))
            partners[other].append((share, one))
    chosen = set(kept)
    for one, others in partners.items():
        for _, other in sorted(others, reverse=True)[: settings.REFINED_PARTNERS]:
            if (min(one, other), max(one, other)) not in chosen:
                chosen.add((max(one, other), min(one, other)))
    return sorted(chosen)


def refine_pairs(
    call: CallEach, pairs: Sequence[Pair], decision: Decision, middles: FloatArray, voxel: float
) -> dict[Pair, Link]:
    """Refine the pose of each pair from that of the scene; return those that stay near it."""
    found = call(confirm, [(pair, (decision.between(*pair),)) for pair in pairs])
    links = {pair: one for pair, one in zip(pairs, found, strict=True) if one is not None}
    if not links:
        return {}
    rows, poses, spread, overlap = stack_links(links, list(links))
    wanted = np.array([decision.between(*pair) for pair in links])
    errors = squared_errors(poses, wanted, spread, middles[rows[:, 0]], voxel)
    is_near = (errors < settings.DISAGREES) & (overlap >= settings.LEAST_FITNESS)
    return dict(itertools.compress(links.items(), is_near))


def refine_on_unions(
    call: CallEach, pairs: Sequence[Pair], decision: Decision, middles: FloatArray
) -> PoseGraph:
    """Refine each scan on the union of its partners; return the pose graph of the results.

    Its frames are at the middles of the scans.
    """
    beside: dict[int, list[int]] = defaultdict(list)
    for one, other in pairs:
        beside[one].append(other)
        beside[other].append(one)
    rows = sorted(beside)
    around = [np.array([decision.between(other, row) for other in beside[row]]) for row in rows]
    tasks = [((row, *beside[row]), (poses,)) for row, poses in zip(rows, around, strict=True)]
    found = call(refine_on_union, tasks)
    edges: list[Pair] = []
    measured: list[FloatArray] = []
    information: list[FloatArray] = []
    for row, one in zip(rows, found, strict=True):
        if one is not None:
            edges += [(row, other) for other in beside[row]]
            measured += [decision.between(row, other) @ one[0] for other in beside[row]]
            information += len(beside[row]) * [one[1] / len(beside[row])]
    stiffness, joined = np.array(information).reshape(-1, 6, 6), np.array(edges, np.int64).reshape(-1, 2)
    return PoseGraph(
        move_frames(decision.poses, middles),
        joined[:, ::-1],
        center_links(joined, np.array(measured).reshape(-1, 4, 4), middles),
        stiffness,
    )


def refine_on_union(*scans_and_poses: Any) -> tuple[FloatArray, FloatArray] | None:  # noqa: ANN401 - both kinds
    """Refine the first scan on the union of the others, whose poses in its frame come last.

    Returns the motion of the scan in its own frame, and the information of the last step about its middle;
    None without overlap, and so far from the origin that rounding makes the information singular.
    """
    *scans, poses = scans_and_poses
    first = scans[0]
    for share in FINE:
        own = first.fine_surface(share)
        if own is None:
            continue
        placed = [apply(pose, scan.thinned(share)) for scan, pose in zip(scans[1:], poses, strict=True)]
        try:
            union = FineSurface(np.concatenate(placed), share * first.voxel, threads=1)
        except InputError:
            continue
        found = align(own, union, np.eye(4), threads=1)
        if len(found.residuals) == 0:
            return None
        noise = found.rmse**2 + (settings.LEAST_DEVIATION * first.voxel) ** 2
        weight = settings.HELD * float(np.trace(found.information[3:, 3:]))
        held, change = weight * np.diag([first.voxel**2] * 3 + [1.0] * 3), about(-first.scan.centroid)
        information = change.T @ found.information @ change
        information = ((information + information.T) / 2 + held) / noise
        return None if singular(information[None])[0] else (found.T_target_source, information)
    return None
