"""A simulated range scanner: visible points of triangle meshes, one per pixel.

The scanner is at the origin and looks along -z, y up. Pixels are spaced evenly on the plane z = -1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cgroup.rigid import apply
from cgroup.types import BoolArray, FloatArray, IndexArray

MAX_INCIDENCE = 75.0  # degrees between line of sight and normal beyond which nothing returns
_STEEPEST = 4.0  # pixels that two neighbours on one surface may be apart; about 1 / cos(MAX_INCIDENCE)


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices (N,3), and triangles (F,3) as rows of them."""

    vertices: FloatArray
    faces: IndexArray

    def move(self, transform: FloatArray) -> Mesh:
        """Apply a 4x4 transform."""
        return Mesh(apply(transform, self.vertices), self.faces)


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """Return the union of several meshes."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])[:-1]
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


@dataclass(frozen=True, eq=False)
class RangeImage:
    """Result of a simulated scan.

    The depth (W,H) is the distance from the scanner's plane per pixel, infinite without a return; the
    corner (2,) is the position of pixel 0, 0 on the plane z = -1; the step is the pixel spacing there.
    """

    depth: FloatArray
    corner: FloatArray
    step: float

    @property
    def seen(self) -> BoolArray:
        """Mask of the pixels with a return."""
        return np.isfinite(self.depth)

    def rays(self) -> FloatArray:
        """Points at distance 1 on the lines of sight with a return, row by row."""
        rows, columns = np.nonzero(self.seen)
        x, y = rows * self.step + self.corner[0], columns * self.step + self.corner[1]
        return np.stack([x, y, -np.ones(len(rows))], axis=1)

    def ranges(self) -> FloatArray:
        """Depths in the order of `rays`."""
        return self.depth[self.seen]

    def points(self, noise: FloatArray | float = 0.0) -> FloatArray:
        """Return the visible points in the order of `rays`, with range noise."""
        return self.rays() * (self.ranges() + noise)[:, None]

    def faces(self) -> IndexArray:
        """Return triangles between neighbouring pixels on one surface, as rows of `points`."""
        number = np.full(self.depth.shape, -1, dtype=np.int64)
        number[self.seen] = np.arange(int(self.seen.sum()))
        a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
        corners = [np.stack(three, axis=-1).reshape(-1, 3) for three in ((a, b, c), (a, c, d))]
        triangles = np.concatenate(corners)
        triangles = triangles[(triangles >= 0).all(axis=1)]
        depths = self.ranges()[triangles]
        flat = np.ptp(depths, axis=1) <= _STEEPEST * self.step * depths.min(axis=1)
        return triangles[flat]


def range_image(mesh: Mesh, *, step: float, offset: FloatArray, two_sided: bool = False) -> RangeImage:
    """Scan a mesh in the scanner's frame, which must be in front of the scanner.

    Pixels are a step apart on the plane z = -1; the image begins an offset (2,) of pixels before the mesh. A
    mesh that is open or not wound alike has to be two-sided; otherwise the corners of triangles run
    counter-clockwise as seen from outside.
    """
    screen = mesh.vertices[:, :2] / -mesh.vertices[:, 2:]
    corner = screen.min(axis=0) - step * offset
    depth, incidence = _depth_image(mesh, (screen - corner) / step, two_sided=two_sided)
    return RangeImage(np.where(incidence < np.radians(MAX_INCIDENCE), depth, np.inf), corner, step)


def _depth_image(mesh: Mesh, screen: FloatArray, *, two_sided: bool) -> tuple[FloatArray, FloatArray]:
    """Return depth and angle of incidence per pixel; infinite without a surface."""
    corners = screen[mesh.faces]
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0]
    facing = np.flatnonzero(area != 0 if two_sided else area > 0)
    corners, edge1, edge2, area = (part[facing] for part in (corners, edge1, edge2, area))
    triangles = mesh.vertices[mesh.faces[facing]]
    nearness = -1 / triangles[:, :, 2]  # linear over the screen, unlike the depth itself
    angles = _incidence(triangles)
    shape = np.ceil(screen.max(axis=0)).astype(int) + 2
    best = np.zeros(shape)
    incidence = np.full(shape, np.inf)
    low = np.ceil(corners.min(axis=1)).astype(int)
    size = np.floor(corners.max(axis=1)).astype(int) - low  # negative between two pixels
    for offset in np.ndindex(*(size.max(axis=0, initial=-1) + 1)):
        wide = np.flatnonzero((size >= offset).all(axis=1))
        pixel = low[wide] + offset
        rest = pixel - corners[wide, 0]
        first, second = edge1[wide], edge2[wide]
        u = (rest[:, 0] * second[:, 1] - rest[:, 1] * second[:, 0]) / area[wide]
        v = (first[:, 0] * rest[:, 1] - first[:, 1] * rest[:, 0]) / area[wide]
        inside = (u >= 0) & (v >= 0) & (u + v <= 1)
        hit, pixel, u, v = wide[inside], pixel[inside], u[inside], v[inside]
        near = nearness[hit, 0] * (1 - u - v) + nearness[hit, 1] * u + nearness[hit, 2] * v
        _keep_nearest(best, incidence, pixel, near, angles[hit])
    with np.errstate(divide="ignore"):
        return 1 / best, incidence


def _keep_nearest(
    best: FloatArray, incidence: FloatArray, pixel: NDArray[np.intp], near: FloatArray, angle: FloatArray
) -> None:
    order = np.argsort(near, kind="stable")  # the nearest is written last
    x, y = pixel[order].T
    near, angle = near[order], angle[order]
    closer = near > best[x, y]
    best[x[closer], y[closer]] = near[closer]
    incidence[x[closer], y[closer]] = angle[closer]


def _incidence(corners: FloatArray) -> FloatArray:
    """Angle in radians between each triangle's normal and the line from it to the scanner."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lines = -corners.mean(axis=1)
    cosine = np.abs((normals * lines).sum(axis=1))
    length = np.linalg.norm(normals, axis=1) * np.linalg.norm(lines, axis=1)
    return np.arccos(np.minimum(1, cosine / np.maximum(length, np.finfo(float).tiny)))
