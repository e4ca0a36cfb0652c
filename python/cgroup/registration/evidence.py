"""Evidence for a pose beside its score: agreeing shape, agreeing planes, and free-space violations.

A floor and two walls fit any other corner. So each plane counts once, whatever its size, and only from the
fifth on: three fix a pose, and among boxes a fourth is found by chance. Other points count by cells of four
voxels, whose samples have correlated errors.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cgroup.registration.planes import count_agreeing
from cgroup.registration.prepare import PreparedScan, fine_surfaces
from cgroup.rigid import invert
from cgroup.types import FloatArray
from cgroup.verification import FineSurface, Place, places
from cgroup.verification.alignment import plane_distances

_ON = 0.75  # largest distance of a sample's plane from the other surface, in spacings


class Evidence(NamedTuple):
    """Evidence for a pose, in both directions."""

    cells: float  # cells off all planes in which most of one fine surface agrees with the other
    planes: int  # independent planes that the pose aligns with planes
    # share of the points seen in both scans that violate the other's free space; NaN without viewpoints
    crossed: float


def gather(source: PreparedScan, target: PreparedScan, pose: FloatArray) -> Evidence:
    """Gather the evidence for a pose."""
    back = invert(pose)
    surfaces = fine_surfaces(source, target)
    cells = [
        _count_cells(one, surface, plane_distances(surface, other, way, one.threads))
        for one, surface, other, way in ((source, *surfaces, pose), (target, *surfaces[::-1], back))
    ]
    planes = max(
        count_agreeing(source.planes, target.planes, pose, source.voxel),
        count_agreeing(target.planes, source.planes, back, source.voxel),
    )
    crossed = np.nan
    if source.viewpoint is not None and target.viewpoint is not None:
        looks = [_look(source, target, pose), _look(target, source, back)]
        crossed = sum(look[0] for look in looks) / max(sum(look[1] for look in looks), 1)
    return Evidence(sum(cells) / 2, planes, crossed)


def _count_cells(scan: PreparedScan, surface: FineSurface, distances: FloatArray) -> int:
    """Count the cells in which most samples near the other surface are on it."""
    cells = scan.cells(surface)
    near = np.isfinite(distances) & (cells >= 0)
    on = near & (distances < _ON * surface.spacing)
    counts = [np.bincount(cells[some], minlength=cells.max(initial=0) + 1) for some in (on, near)]
    return int((2 * counts[0] > counts[1]).sum())


def _look(one: PreparedScan, other: PreparedScan, pose: FloatArray) -> tuple[int, int]:
    """Return the numbers of voxels in the other's free space, and of all visible voxels."""
    where = places(one.surface, other.surface, pose, threads=one.threads)
    crossed = int((where == Place.IN_FRONT).sum())
    return crossed, crossed + int(((where == Place.ON) | (where == Place.OFF)).sum())
