"""Point clouds, also those of other libraries."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup._checks import arrays
from cgroup._checks.foreign import cloud_parts
from cgroup.errors import InputError
from cgroup.rigid import apply, check_rigid


class _HasPoints(Protocol):  # clouds of Open3D, small_gicp, PyVista and laspy
    @property
    def points(self) -> Any: ...  # noqa: ANN401 - of the library's own kind, here and below


class _HasVertices(Protocol):  # meshes of Open3D and trimesh
    @property
    def vertices(self) -> Any: ...  # noqa: ANN401


class _HasPoint(Protocol):  # clouds of Open3D's tensors
    @property
    def point(self) -> Any: ...  # noqa: ANN401


class _HasVertex(Protocol):  # meshes of Open3D's tensors
    @property
    def vertex(self) -> Any: ...  # noqa: ANN401


class _IsMessage(Protocol):  # clouds of ROS
    fields: Any
    data: Any


_Foreign: TypeAlias = _HasPoints | _HasVertices | _HasPoint | _HasVertex | _IsMessage


@dataclass(frozen=True, eq=False)
class PointCloud:
    """A scan or a model, as read from a file.

    Attributes
    ----------
    points : (N,3) array of float64
        Coordinates in the file's unit, all finite.
    normals : (N,3) array of float64, optional
        Normals as stored in the file.
    faces : (M,3) array of int, optional
        Triangles as rows of `points`.
    colors : (N,3) array of uint8, optional
        Red, green, blue.
    dropped : int
        Points of the file that were dropped: a coordinate was NaN or infinite, the scanner got no return, or
        a splat was nearly transparent.
    viewpoint : (3,) array of float64, optional
        Position of the scanner in the frame of the points, if the file has it. The origin in PCD and E57
        counts as unknown, as writers put it there by default. None for a file of scans from several places.
    intensities : (N,) array of float32, optional
        Strengths of the returns, in the file's unit; those of LAS are not read.

    Examples
    --------
    >>> from cgroup.types import PointCloud
    >>> len(PointCloud([[0.0, 0, 0], [1, 0, 0]]))
    2
    """

    points: arrays.FloatArray
    normals: arrays.FloatArray | None = None
    faces: arrays.IndexArray | None = None
    colors: NDArray[np.uint8] | None = None
    dropped: int = 0
    viewpoint: arrays.FloatArray | None = None
    intensities: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)

    def transformed(self, transform: ArrayLike) -> PointCloud:
        """Move the cloud by a rigid transform.

        Parameters
        ----------
        transform : (4,4) array_like of float
            Applied to column vectors: p' = R p + t.

        Returns
        -------
        PointCloud
            Moved points and viewpoint, rotated normals; all else unchanged.
        """
        matrix = check_rigid(transform)
        normals = None if self.normals is None else self.normals @ matrix[:3, :3].T
        place = None if self.viewpoint is None else apply(matrix, np.array([self.viewpoint]))[0]
        return replace(self, points=apply(matrix, self.points), normals=normals, viewpoint=place)

    def select(self, mask: ArrayLike) -> PointCloud:
        """Return the points of a mask with their attributes, and the triangles among them.

        Parameters
        ----------
        mask : (N,) array_like of bool
            True for points to keep.

        Returns
        -------
        PointCloud
            In the same order, with the same viewpoint.

        Raises
        ------
        InputError
            If there is not one value per point.

        Examples
        --------
        >>> from cgroup.types import PointCloud
        >>> PointCloud([[0.0, 0, 0], [1, 0, 0]]).select([False, True]).points.tolist()
        [[1.0, 0.0, 0.0]]
        """
        kept = arrays.as_mask("mask", mask)
        if len(kept) != len(self):
            raise InputError("mask", f"{len(kept)} values for {len(self)} points", "give one per point")
        names = ("points", "normals", "colors", "intensities")
        there = {name: values for name in names if (values := getattr(self, name)) is not None}
        faces = None if self.faces is None else arrays.as_faces("faces", self.faces)
        sizes = {name: len(values) for name, values in there.items()}
        if {*sizes.values()} != {len(self)} or (faces is not None and faces.max(initial=-1) >= len(self)):
            raise InputError("cloud", f"{sizes}, or faces of further points", "give one value per point")
        if faces is not None:
            faces = (np.cumsum(kept) - 1)[faces[kept[faces].all(axis=1)]]
        return replace(self, faces=faces, **{name: np.asarray(there[name])[kept] for name in there})

    def crop(self, low: ArrayLike, high: ArrayLike) -> PointCloud:
        """Return the points within a box, as `select` does.

        Parameters
        ----------
        low, high : (3,) array_like of float
            Least and greatest x, y and z, in the unit of the points; -inf and inf are no bounds.

        Returns
        -------
        PointCloud
            Of the points within the box or on its border.

        Raises
        ------
        InputError
            If a bound is NaN, or a least one is above the greatest.

        Examples
        --------
        >>> from cgroup.types import PointCloud
        >>> len(PointCloud([[0.0, 0, 0], [1, 0, 0]]).crop([0, 0, 0], [0.5, 9, 9]))
        1
        """
        ends = [arrays.as_floats(name, end) for name, end in (("low", low), ("high", high))]
        if any(end.shape != (3,) for end in ends) or not (ends[0] <= ends[1]).all():
            raise InputError("low, high", f"{ends[0]}, {ends[1]}", "give x, y, z of a box, the least first")
        points = arrays.as_points("points", self.points)
        return self.select(((points >= ends[0]) & (points <= ends[1])).all(axis=1))


def join_clouds(clouds: Sequence[PointCloud]) -> PointCloud:
    """Join clouds: attributes of points if all have them, the viewpoint if it is the same."""
    if not clouds:
        return PointCloud(np.empty((0, 3)))
    starts = np.cumsum([0, *map(len, clouds)])
    shifted = zip(clouds, starts, strict=False)
    faces = [cloud.faces + start for cloud, start in shifted if cloud.faces is not None]
    names = ("points", "normals", "colors", "intensities")
    values = {name: [getattr(cloud, name) for cloud in clouds] for name in names}
    joined: dict[str, Any] = {
        name: np.concatenate(each) for name, each in values.items() if not any(one is None for one in each)
    }
    places = [cloud.viewpoint for cloud in clouds if cloud.viewpoint is not None]
    is_one = len(places) == len(clouds) and (np.array(places) == places[0]).all()
    viewpoint = places[0] if is_one else None
    return PointCloud(**joined, faces=np.concatenate(faces) if faces else None, viewpoint=viewpoint)


AnyCloud: TypeAlias = "PointCloud | ArrayLike | os.PathLike[str] | _Foreign"
"""Points in any form: a cloud, that of another library, an array, a data frame, or the path of a file."""


def find_cloud(name: str, cloud: object) -> PointCloud | None:
    """Return a `PointCloud`, also from a cloud of another library; None for arrays."""
    if isinstance(cloud, PointCloud):
        return cloud
    parts = cloud_parts(name, cloud)
    if parts is None:
        return None
    normals = parts.normals
    if normals is not None:
        normals = arrays.in_double(arrays.real_normals(f"{name}.normals", normals))
    faces = None if parts.faces is None else arrays.as_faces(f"{name}.faces", parts.faces)
    points = arrays.as_points(name, parts.points)
    colors = arrays.as_colors(parts.colors, len(points))
    return PointCloud(points, normals, faces, colors, 0, parts.viewpoint, parts.intensities)


def as_cloud(name: str, cloud: AnyCloud) -> PointCloud:
    """Return a `PointCloud` of points in any form."""
    if isinstance(cloud, PointCloud):
        return cloud
    return find_cloud(name, cloud) or PointCloud(arrays.as_points(name, cloud))
