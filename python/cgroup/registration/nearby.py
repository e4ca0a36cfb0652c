"""Start poses near a rough pose: a grid, reduced to the best on coarse surfaces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cgroup import features
from cgroup._checks.values import as_length, refusal
from cgroup.errors import InputError
from cgroup.features.voxels import thin
from cgroup.registration.prepare import UNIT, PreparedScan
from cgroup.rigid import apply, check_rigid
from cgroup.rigid.se3 import motion
from cgroup.types import BoolArray, FloatArray
from cgroup.verification import Surface, verify

ANGLE, RADIUS = 15.0, 0.2  # default error of a rough pose: degrees, and share of the source's diagonal
MOST_TURNED = 60.0  # angle in degrees beyond which a global search is faster
_COARSER, _OF_RADIUS = 3.0, 0.14  # coarse voxels, in voxels; at least that share of the radius
_OF_CLOUD = 0.16  # coarse voxels at most, of the smaller diagonal
_STEP, _TURN = 2.7, 15.0  # between starts: coarse voxels, degrees
_NORMAL_RADIUS = 2.0
_SLACK = 1.0  # voxels, and degrees


def as_nearby(initial: ArrayLike | None, radius: float | None, angle: float | None) -> Nearby | None:
    """Check a rough pose, if any, and its largest error."""
    told = {"radius": radius, "angle": angle}
    given = {name: as_length(name, value) for name, value in told.items() if value is not None}
    if initial is None:
        for name, value in given.items():
            raise InputError(name, f"{value:g}, but no `initial`", "it is the largest error of that pose")
        return None
    degrees = given.get("angle", ANGLE)
    if degrees > MOST_TURNED:
        raise refusal("angle", angle, f"give {MOST_TURNED:g} degrees at most, or no `initial`")
    return Nearby(check_rigid(initial, "initial"), degrees, given.get("radius", 0.0))


class Nearby(NamedTuple):
    """A rough pose, and its largest error."""

    pose: FloatArray  # (4,4), pose of the source in the target's frame
    angle: float  # error of its rotation, in degrees
    radius: float  # error at the middle of the source; 0 for the default until `around`

    def around(self, source: PreparedScan) -> Nearby:
        """Return the rough pose with the default radius of a source, unless a radius was given."""
        return self._replace(radius=self.radius or RADIUS * source.scan.diagonal)

    def holds(self, poses: FloatArray, scan: PreparedScan) -> BoolArray:
        """Return the mask of poses within the allowed error, plus a voxel and a degree."""
        cosines = (np.einsum("nij,ij->n", poses[:, :3, :3], self.pose[:3, :3]) - 1) / 2
        middle = scan.scan.centroid
        away = np.linalg.norm((poses - self.pose)[:, :3] @ np.append(middle, 1.0), axis=1)
        turned = cosines >= np.cos(np.radians(self.angle + _SLACK))
        return turned & (away <= self.radius + _SLACK * scan.voxel)

    def propose(self, source: PreparedScan, target: PreparedScan, threads: int | None) -> FloatArray:
        """Propose poses, (m,4,4): the best shifts of each turn of a grid, on coarse surfaces."""
        diagonals = source.scan.diagonal, target.scan.diagonal
        size = min(max(_COARSER * source.voxel, _OF_RADIUS * self.radius), _OF_CLOUD * min(diagonals))
        size = max(size, source.voxel)
        one, other = (_coarse_surface(scan, size, threads) for scan in (source, target))
        axes = target.scan.axes  # not those of the frame, on which nothing may depend
        middle = apply(self.pose, source.scan.centroid[None])[0]
        apart = float(np.linalg.norm(middle - target.scan.centroid))
        shifts = _ball(min(self.radius, apart + sum(diagonals) / 2), _STEP * size) @ axes
        found: list[FloatArray] = []
        for turn in _ball(np.radians(self.angle), np.radians(_TURN)) @ axes:
            starts = np.tile(motion(np.append(turn, np.zeros(3)), middle) @ self.pose, (len(shifts), 1, 1))
            starts[:, :3, 3] += shifts
            found.append(verify(one, other, starts, threads=threads).poses)
        return np.concatenate(found)


def _ball(radius: float, step: float) -> FloatArray:
    """Return grid points within a radius of the origin, (m,3), the origin first."""
    count = int(np.ceil(radius / step))
    ticks = np.linspace(-radius, radius, 2 * count + 1)
    grid = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[np.linalg.norm(grid, axis=1) <= radius * (1 + 1e-9)]


def _coarse_surface(scan: PreparedScan, size: float, threads: int | None) -> Surface:
    points = features.Cloud(thin(scan.voxels.points, size, threads=threads).points)
    normals = features.normals(
        points,
        radius=_NORMAL_RADIUS * size,
        neighbors=30,
        viewpoint=scan.viewpoint or features.ORIGIN,
        threads=threads,
    )
    oriented = not scan.by_frames
    unit = UNIT * size
    return Surface(points, normals, unit=unit, viewpoint=scan.viewpoint, oriented=oriented, threads=threads)
