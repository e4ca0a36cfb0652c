"""Sample the faces of a mesh."""

from __future__ import annotations

import numpy as np

from cgroup._checks.arrays import as_faces, as_points
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_length
from cgroup.errors import InputError
from cgroup.features.surface import mesh_normals
from cgroup.types import AnyCloud, FloatArray, IndexArray, PointCloud
from cgroup.types.point_cloud import as_cloud

_USUAL_POINTS, _MOST_ON_EDGES, _MOST_POINTS = 40_000, 1_000_000, 20_000_000  # on edges: of slivers


@explain_wrong_calls
def sample_mesh(mesh: AnyCloud, *, spacing: float | None = None) -> PointCloud:
    """Return the vertices of a mesh, and points on its large faces.

    A face gets rows of points parallel to its longest edge. They depend on that face and on the spacing, and
    neither on random numbers nor on the order of faces or vertices (but for a face with two longest edges).

    Parameters
    ----------
    mesh : PointCloud, path or mesh of another library
        With triangles. Faces without area, and vertices of no other face, are left out.
    spacing : float, optional
        Largest distance between neighbouring points of a face, in the unit of the points; by default some
        40,000 points are made if the faces are large.

    Returns
    -------
    PointCloud
        Points and unit normals, which point outwards if the mesh is closed; the vertices are first.
    """
    cloud = as_cloud("mesh", mesh)
    size = None if spacing is None else as_length("spacing", spacing)
    if cloud.faces is None:
        raise InputError("mesh", "no faces", "give a mesh of triangles")
    points, faces = as_points("mesh", cloud.points), as_faces("mesh.faces", cloud.faces)
    normals = mesh_normals(points, faces)
    corners = points[faces]
    with np.errstate(over="ignore"):  # refused below
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        doubled = np.linalg.norm(across, axis=1)
    if not 0 < doubled.sum() < np.inf:
        raise InputError("mesh.faces", "no face with an area", "give a mesh of triangles")
    solid = np.flatnonzero(doubled > 0)
    faces, corners, across, doubled = faces[solid], corners[solid], across[solid], doubled[solid]
    if size is None:
        size = max(np.sqrt(doubled.sum() / 2 / _USUAL_POINTS), longest_edges(corners).sum() / _MOST_ON_EDGES)
    used = np.unique(faces)
    # An area with a side: that of the normals of its corners.
    inwards = np.einsum("fx,fx->f", across, np.nansum(normals[faces], axis=1)) < 0
    outwards = np.where(inwards, -1.0, 1.0)[:, None] * across / doubled[:, None]
    large = np.flatnonzero(longest_edges(corners) > size)
    places, rows = _sample_triangles(corners[large], doubled[large], size)
    directions = np.concatenate([normals[used], outwards[large][rows]])
    return PointCloud(np.concatenate([points[used], places]), directions)


def longest_edges(corners: FloatArray) -> FloatArray:
    """Return the longest edge of triangles, (F,3,3)."""
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)


def _sample_triangles(
    corners: FloatArray, doubled: FloatArray, spacing: float
) -> tuple[FloatArray, IndexArray]:
    """Return points in rows along the longest edge of triangles, and the triangle of each."""
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    start = np.argmax(edges, axis=1)
    each = np.arange(len(corners))
    first, second, apex = (corners[each, (start + step) % 3] for step in range(3))
    length = edges[each, start]
    with np.errstate(over="ignore"):  # to infinity, which is too many
        counts = np.ceil(doubled / length / spacing)
        total = float((doubled / 2 / spacing / spacing + counts + length / spacing).sum())
    if not total <= _MOST_POINTS:
        got = f"{spacing:.3g}, which makes about {total:.3g} points"
        remedy = f"give a larger one, or a mesh in the right unit: {_MOST_POINTS:,} points are allowed"
        raise InputError("spacing", got, remedy)
    triangle, step = _count_up(counts.astype(np.int64))
    height = (step + 0.5) / counts[triangle]
    parts = np.ceil(length[triangle] * (1 - height) / spacing)
    row, step = _count_up(parts.astype(np.int64))
    triangle, height = triangle[row], height[row][:, None]
    along = ((step + 0.5) / parts[row])[:, None]
    base = first[triangle] * (1 - along) + second[triangle] * along
    return base * (1 - height) + apex[triangle] * height, triangle


def _count_up(counts: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Return each row repeated by its count, and the index of each repetition."""
    rows = np.repeat(np.arange(len(counts)), counts)
    return rows, np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
