"""Downsample a cloud to one point per grid cell."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup import _core
from cgroup._checks.arrays import real_normals
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_count, as_length, run_options
from cgroup.errors import InputError
from cgroup.features.cloud import Cloud, CloudLike, core_cloud, places_of
from cgroup.types import FloatArray, IndexArray, RealArray
from cgroup.types.point_cloud import find_cloud


@dataclass(frozen=True, eq=False)
class Voxels:
    """A cloud downsampled to one point per occupied cell of a grid.

    Row i of `points` and of `normals` is one voxel.

    Attributes
    ----------
    points : (M,3) array of float64
        Mean of each voxel's points. Neighbouring rows are mostly neighbours in space.
    normals : (M,3) array of float64 or None
        Mean of their normals, of unit length; NaN rows where they have none, or cancel. None if none were
        given.
    indices : (N,) array of int64
        Voxel of every point of the cloud.
    colors : (M,3) array of uint8 or None
        Mean of each voxel's colours, rounded to the nearest. None if the cloud has none.
    intensities : (M,) array of float32 or None
        Mean of each voxel's intensities. None if the cloud has none.
    """

    points: FloatArray
    normals: FloatArray | None
    indices: IndexArray
    colors: NDArray[np.uint8] | None = None
    intensities: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"Voxels(n={len(self)}, of={len(self.indices)})"


@explain_wrong_calls
def voxel_downsample(
    points: CloudLike, voxel: float, *, normals: ArrayLike | None = None, threads: int | None = None
) -> Voxels:
    """Replace the points in each cell of a regular grid by their mean.

    As Open3D's ``voxel_down_sample``: the grid begins half a cell below the least coordinates. Cost O(N log
    N). `threads` is as for `shot`.

    Parameters
    ----------
    points : PointCloud, Cloud, path or (N,3) array_like of float
        Finite, in any unit; make a `Cloud` of them once for several steps. Normals and colours of a
        `PointCloud`, of a file and of other libraries' clouds are averaged too.
    voxel : float
        Edge length of a cell, in the unit of the points.
    normals : (N,3) array_like of float, optional
        Averaged like the points, in place of those of the cloud; NaN rows are left out.

    Returns
    -------
    Voxels
        The means, and the voxel of every point.

    Examples
    --------
    >>> from cgroup import features
    >>> voxels = features.voxel_downsample([[0, 0, 0], [0.2, 0, 0], [5, 0, 0]], 1.0)
    >>> voxels.points.round(3).tolist(), voxels.indices.tolist()
    ([[0.1, 0.0, 0.0], [5.0, 0.0, 0.0]], [0, 0, 1])
    """
    cloud = None if isinstance(points, Cloud) else find_cloud("points", points)
    stored = cloud.normals if normals is None and cloud is not None else normals
    directions = None if stored is None else real_normals("normals", stored)
    size = as_length("voxel", voxel)
    means, normal_means, indices = _core.voxel_downsample(
        core_cloud(points if cloud is None else cloud), directions, run_options(threads), size, own_axes=False
    )
    given = None if cloud is None else (cloud.colors, cloud.intensities)
    colors, strengths = map(partial(_means, indices), ("colors", "intensities"), given or (None, None))
    return Voxels(
        means,
        normal_means,
        indices,
        None if colors is None else np.rint(colors).astype(np.uint8),
        None if strengths is None else strengths[:, 0].astype(np.float32),
    )


def _means(voxels: IndexArray, name: str, values: NDArray[Any] | None) -> FloatArray | None:
    if values is None:
        return None
    if len(values) != len(voxels):
        raise InputError(f"points.{name}", f"{len(values)} for {len(voxels)} points", "give one per point")
    sums = [np.bincount(voxels, weights=band) for band in np.atleast_2d(np.asarray(values).T)]
    return np.stack(sums, axis=1) / np.bincount(voxels)[:, None]


@explain_wrong_calls
def choose_voxel(*clouds: CloudLike, voxels: int = 5000, threads: int | None = None) -> float:
    """Choose the voxel size at which clouds have about a given number of voxels.

    The smallest d 2^(k/16), d the longest diagonal and k a whole number, at which the clouds have at most
    `voxels` voxels on average and at least two distinct points per voxel. It grows with the clouds: it does
    not depend on their unit. Cost O(N), a few times. `threads` is as for `shot`.

    Parameters
    ----------
    *clouds : Cloud or (N,3) array_like of float
        One or more, in the same unit.
    voxels : int
        Largest average number of voxels per cloud.

    Returns
    -------
    float
        A length in the unit of the points.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> cloud = features.Cloud(standin_pair(pixels=60).source.points)
    >>> voxel = features.choose_voxel(cloud, voxels=500)
    >>> 350 < len(features.voxel_downsample(cloud, voxel)) <= 500
    True
    """
    if not clouds:
        raise InputError("clouds", "none", "give one cloud or more")
    most = as_count("voxels", voxels, 1)
    cores = [places_of(cloud, f"clouds[{row}]").core for row, cloud in enumerate(clouds)]
    return _core.choose_voxel(cores, run_options(threads), most, own_axes=False)


def thin(
    points: CloudLike, voxel: float, *, normals: RealArray | None = None, threads: int | None = None
) -> Voxels:
    """Downsample along the cloud's own axes, so that voxels depend on the frame by rounding only."""
    options = run_options(threads)
    return Voxels(*_core.voxel_downsample(core_cloud(points), normals, options, voxel, own_axes=True))


def choose_thinning(*clouds: CloudLike, voxels: int, threads: int | None) -> float:
    """Choose the voxel size for `thin`, as `choose_voxel` does."""
    cores = [places_of(cloud).core for cloud in clouds]
    return _core.choose_voxel(cores, run_options(threads), voxels, own_axes=True)
