"""Refine all scans of a scene together, on their surfaces."""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import TYPE_CHECKING

import numpy as np

from cgroup.rigid import apply
from cgroup.scenes.agreement import DISAGREES, squared_errors
from cgroup.scenes.links import confirm

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from cgroup.registration import PreparedScan
    from cgroup.scenes.decide import Decision
    from cgroup.scenes.links import Link
    from cgroup.scenes.workers import CallEach
    from cgroup.types import FloatArray

PARTNERS = 6
"""Scans that each scan is laid on, those that it shares most with."""

_CELL = 3.0  # voxels within which two scans share a place
_LEAST_SHARED, _LEAST_FITNESS = 0.15, 0.1


def find_overlapping(
    scans: Sequence[PreparedScan], decision: Decision, kept: Collection[tuple[int, int]]
) -> list[tuple[int, int]]:
    """Return the pairs that share most, of each scan, and those that are kept."""
    holders: dict[tuple[int, ...], list[int]] = defaultdict(list)
    sizes = np.zeros(len(scans))
    for row, scan in enumerate(scans):
        placed = apply(decision.poses[row], scan.voxels.points)
        cells = np.unique(np.floor(placed / (_CELL * scan.voxel)).astype(np.int64), axis=0)
        sizes[row] = len(cells)
        label = int(decision.labels[row])
        for cell in cells.tolist():
            holders[label, *cell].append(row)
    shared: Counter[tuple[int, int]] = Counter()
    for rows in holders.values():
        shared.update((one, other) for k, one in enumerate(rows) for other in rows[:k])
    partners: dict[int, list[tuple[float, int]]] = defaultdict(list)
    for (one, other), cells in shared.items():
        share = cells / min(sizes[one], sizes[other])
        if share >= _LEAST_SHARED:
            partners[one].append((share, other))
            partners[other].append((share, one))
    chosen = set(kept)
    for one, others in partners.items():
        for _, other in sorted(others, reverse=True)[:PARTNERS]:
            if (min(one, other), max(one, other)) not in chosen:
                chosen.add((max(one, other), min(one, other)))
    return sorted(chosen)


def lay_on_each_other(
    call: CallEach, pairs: Sequence[tuple[int, int]], decision: Decision, middles: FloatArray, voxel: float
) -> dict[tuple[int, int], Link]:
    """Refine the pose of each pair from where the scene puts it; return those that stay there."""
    expected = [decision.between(*pair) for pair in pairs]
    found = call(confirm, [(pair, (pose,)) for pair, pose in zip(pairs, expected, strict=True)])
    rows = [row for row, one in enumerate(found) if one is not None]
    if not rows:
        return {}
    errors = squared_errors(
        np.array([found[row].pose for row in rows]),
        np.array([expected[row] for row in rows]),
        np.array([found[row].covariance for row in rows]),
        middles[[pairs[row][0] for row in rows]],
        voxel,
    )
    return {
        pairs[row]: found[row]
        for row, error in zip(rows, errors.tolist(), strict=True)
        if error < DISAGREES and min(found[row].fitness, found[row].target_fitness) >= _LEAST_FITNESS
    }
