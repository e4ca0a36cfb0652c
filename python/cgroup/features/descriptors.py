"""Descriptors of the surface around keypoints."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup import _core
from cgroup._arguments import as_count, real_frames, real_points
from cgroup._options import run_options
from cgroup.errors import InputError
from cgroup.features import _open3d
from cgroup.features._lengths import positive_length
from cgroup.features._rows import as_rows
from cgroup.features.cloud import core_cloud, points_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from cgroup.features.cloud import CloudLike


def shot(
    points: CloudLike,
    normals: ArrayLike,
    keypoints: ArrayLike,
    *,
    radius: float,
    lrf: ArrayLike | None = None,
    pcl_compat: bool = True,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """SHOT-352 descriptors (Tombari, Salti, Di Stefano, ECCV 2010; as PCL's ``SHOTEstimation``).

    Histograms of the angle between the neighbours' normals and the frame's z axis, in 32 volumes of the
    ball. Cost O(m k), k points per ball.

    Parameters
    ----------
    points : Cloud or (N,3) array_like of float
    normals : (N,3) array_like of float
        Consistently oriented; neighbours with a NaN row are left out.
    keypoints : (m,) array_like of int
        Row numbers of points.
    radius : float
        Radius of the support; the paper's is 15 pr.
    lrf : (m,3,3) array_like of float, optional
        Frames to use; SHOT's own of the same radius by default.
    pcl_compat : bool
        Wrap the cosine's interpolation past the last-but-one bin to the first, as PCL does.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (m,352) array of float32
        Rows of unit length; NaN rows without a frame or with fewer than 5 points in the ball.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> descriptors = features.shot(points, features.normals(points), [0, 500], radius=15 * pr)
    >>> descriptors.shape, np.linalg.norm(descriptors, axis=1).round(3).tolist()
    ((2, 352), [1.0, 1.0])
    """
    rows = as_rows("keypoints", keypoints)
    frames = None if lrf is None else real_frames("lrf", lrf, len(rows))
    return _core.shot(
        core_cloud(points),
        real_points("normals", normals),
        rows,
        run_options(threads),
        radius=radius,
        lrf=frames,
        pcl_compat=pcl_compat,
    )


def lfsh(
    points: CloudLike,
    normals: ArrayLike,
    keypoints: ArrayLike,
    *,
    radius: float,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """LFSH-30 descriptors, local feature statistics histograms (Yang, Cao, Zhang, Neurocomputing 2016).

    Histograms of local depth, horizontal distance from the normal's axis, and angle between normals. Cost
    O(m k), k points per ball.

    Parameters
    ----------
    points : Cloud or (N,3) array_like of float
    normals : (N,3) array_like of float
        Consistently oriented.
    keypoints : (m,) array_like of int
        Row numbers of points.
    radius : float
        Radius of the support; the paper's is 15 pr.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (m,30) array of float32
        Three histograms, each of sum 1; zero rows with fewer than 6 points in the ball, NaN rows where the
        keypoint has no normal.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> descriptors = features.lfsh(points, features.normals(points), [0, 500], radius=15 * pr)
    >>> descriptors.shape, descriptors[0, :10].sum().round(3).item()
    ((2, 30), 1.0)
    """
    return _core.lfsh(
        core_cloud(points),
        real_points("normals", normals),
        as_rows("keypoints", keypoints),
        run_options(threads),
        radius,
    )


def rcs(
    points: CloudLike, keypoints: ArrayLike, *, radius: float, threads: int | None = None
) -> NDArray[np.float32]:
    """RCS-72 descriptors, rotational contour signatures (Yang et al., CVIU 2017).

    The outline of the local surface in twelve directions, seen from six sides. Needs no normals. Cost
    O(m k), k points per ball.

    Parameters
    ----------
    points : Cloud or (N,3) array_like of float
    keypoints : (m,) array_like of int
        Row numbers of points.
    radius : float
        Radius of the support; the paper's is 15 pr.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (m,72) array of float32
        Values in [0,1]; zero rows where too few points, or a plane, make no frame.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> features.rcs(points, [0, 500], radius=15 * pr).shape
    (2, 72)
    """
    return _core.rcs(
        core_cloud(points),
        as_rows("keypoints", keypoints),
        run_options(threads),
        radius,
    )


def fpfh(
    points: CloudLike,
    normals: ArrayLike,
    *,
    radius: float,
    max_neighbors: int | None = None,
) -> NDArray[np.float32]:
    """FPFH-33 descriptors of all points (Rusu et al., ICRA 2009), computed by Open3D.

    Needs the extra ``open3d``. Not among the paper's six combinations.

    Parameters
    ----------
    points : Cloud or (N,3) array_like of float
    normals : (N,3) array_like of float
        Consistently oriented.
    radius : float
        Radius of the support.
    max_neighbors : int, optional
        At most this many nearest neighbours; all within the radius by default.

    Returns
    -------
    (N,33) array of float32

    Raises
    ------
    CgroupError
        Where Open3D can't be imported; the message names what to install.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> features.fpfh(points, features.normals(points), radius=15 * pr).shape  # doctest: +SKIP
    (2287, 33)
    """
    cloud, directions = points_of(points), real_points("normals", normals)
    if len(directions) != len(cloud):
        message = f"normals: got {len(directions)} rows; give one normal per point, here {len(cloud)}"
        raise InputError(message)
    positive_length("radius", radius)
    limit = None if max_neighbors is None else as_count("max_neighbors", max_neighbors, 1)
    return _open3d.fpfh(cloud, directions, radius, limit)
