"""Whole models: clouds that know their outside."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup import features
from cgroup._checks.arrays import as_points
from cgroup._checks.values import as_length
from cgroup.errors import InputError
from cgroup.registration.scan import NEEDED_FOR, as_point_cloud, as_scan
from cgroup.types import PointCloud

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.features import Cloud
    from cgroup.registration.scan import Normals, Scan
    from cgroup.types import FloatArray

_MOST_POINTS = 20_000_000
_USUAL_POINTS = 40_000
_MESH_SPACING = 0.5  # voxels between points on a large face


def as_model(name: str, cloud: PointCloud | Cloud | ArrayLike, normals: Normals, voxel: float | None) -> Scan:
    """Check a whole model, whose normals or faces tell its outside."""
    cloud = as_point_cloud(name, cloud)
    if not isinstance(cloud, PointCloud) or getattr(cloud, NEEDED_FOR[normals]) is None:
        message = (
            f"{name}: got no {NEEDED_FOR[normals]}, which tell the outside of a model; give a `PointCloud` "
            "with them, or another library's cloud or mesh"
        )
        raise InputError(message)
    if normals == "given":
        return as_scan(name, cloud)
    return as_scan(
        name, sample_mesh(cloud, None if voxel is None else _MESH_SPACING * as_length("voxel", voxel))
    )


def sample_mesh(mesh: PointCloud, spacing: float | None) -> PointCloud:
    """Return the vertices of a mesh, points between them on large faces, and normals outwards.

    Parameters
    ----------
    mesh : PointCloud
        With faces.
    spacing : float or None
        Largest distance between neighbouring points of a face, in the unit of the points; None for some
        40,000 points.

    Returns
    -------
    PointCloud
        Vertices first; normals are NaN for vertices that no face has.

    Raises
    ------
    InputError
        If that were too many points.
    """
    assert mesh.faces is not None  # noqa: S101 - the caller looks
    points, faces = as_points("model", mesh.points), np.asarray(mesh.faces)
    normals = features.mesh_normals(points, faces)
    corners = points[faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if spacing is None:
        spacing = float(np.sqrt(np.linalg.norm(across, axis=1).sum() / 2 / _USUAL_POINTS))
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
    parts = np.maximum(np.ceil(longest / spacing), 1)
    total = len(points) + float((parts**2).sum()) / 2
    if total > _MOST_POINTS:
        message = (
            f"model: {total:.3g} points would lie {spacing:.3g} apart on its faces; "
            "give it in the scene's unit, or a larger `voxel`"
        )
        raise InputError(message)
    # An area with a side: that of the normals of its corners.
    inwards = np.einsum("fx,fx->f", across, np.nansum(normals[faces], axis=1)) < 0
    outwards = np.where(inwards, -1.0, 1.0)[:, None] * across
    places, directions = [points], [normals]
    for count in np.unique(parts[parts > 1]).astype(int):
        chosen = np.flatnonzero(parts == count)
        weights = _barycentric_grid(count)
        places.append(np.einsum("gk,fkx->fgx", weights, corners[chosen]).reshape(-1, 3))
        directions.append(np.repeat(outwards[chosen], len(weights), axis=0))
    return PointCloud(np.concatenate(places), np.concatenate(directions))


def _barycentric_grid(parts: int) -> FloatArray:
    """Weights of points on a triangle whose edges are cut into parts, without its corners."""
    first, second = (steps.reshape(-1) for steps in np.meshgrid(*2 * [np.arange(parts + 1)], indexing="ij"))
    steps = np.stack([first, second, parts - first - second], axis=1)
    return steps[(steps >= 0).all(axis=1) & (steps < parts).all(axis=1)] / parts
