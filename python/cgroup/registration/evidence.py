"""What speaks for a pose beside its score: shape that agrees, planes that agree, free space that is crossed.

A floor and two walls lie on any other corner. So planes count once each, however large they are, and only
from the fourth on, as three fix a pose; what lies on no plane counts by cells of four voxels, whose
samples go wrong together.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup.registration.planes import count_agreeing
from cgroup.rigid import invert
from cgroup.verification import Place, places

if TYPE_CHECKING:
    from cgroup.registration.prepare import PreparedScan
    from cgroup.types import FloatArray


class Evidence(NamedTuple):
    """What speaks for a pose, both ways.

    Attributes
    ----------
    cells : float
        Cells off all planes where one surface lies on the other.
    planes : int
        Independent planes that the pose lays on planes.
    crossed : float
        Share of what is seen in both scans that stands in the other's free space; NaN where no viewpoint is
        known.
    """

    cells: float
    planes: int
    crossed: float


def gather(source: PreparedScan, target: PreparedScan, pose: FloatArray) -> Evidence:
    """Gather the evidence for a pose."""
    found = [
        _look(one, other, way) for one, other, way in ((source, target, pose), (target, source, invert(pose)))
    ]
    on, crossed, seen = (sum(values) for values in zip(*found, strict=True))
    planes = max(
        count_agreeing(source.planes, target.planes, pose, source.voxel),
        count_agreeing(target.planes, source.planes, invert(pose), source.voxel),
    )
    known = source.viewpoint is not None and target.viewpoint is not None
    return Evidence(on / 2, planes, crossed / max(seen, 1) if known else np.nan)


def _look(one: PreparedScan, other: PreparedScan, pose: FloatArray) -> tuple[int, int, int]:
    """Count cells on the other surface, and voxels in its free space and seen at all."""
    where = places(one.surface, other.surface, pose, threads=one.threads)
    on = where == Place.ON
    crossed = int((where == Place.IN_FRONT).sum())
    seen = crossed + int((on | (where == Place.OFF)).sum())
    return len(np.unique(one.cells[on & (one.planes.labels < 0)])), crossed, seen
