"""Local reference frames and descriptors of the surface around keypoints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup import _core
from cgroup._checks.arrays import as_rows, real_frames, real_normals
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_count, as_flag, as_number, run_options
from cgroup.features.cloud import CloudLike, places_of
from cgroup.types import FloatArray, IndexArray


@dataclass(frozen=True, eq=False)
class DescribedCloud:
    """Described keypoints; row i of each array is one keypoint.

    Attributes
    ----------
    indices : (m,) array of int64
        Rows of the cloud, ascending.
    points : (m,3) array of float64
        Positions.
    lrf : (m,3,3) array of float64
        SHOT's local reference frames, rows are the axes; NaN for missing ones.
    descriptors : (m,d) array of float32
        All finite, none zero.
    resolution : float
        The unit pr that the radii were multiples of.
    centroid : (3,) array of float64
        Of the whole cloud.
    """

    indices: IndexArray
    points: FloatArray
    lrf: FloatArray
    descriptors: NDArray[np.float32]
    resolution: float
    centroid: FloatArray

    def __len__(self) -> int:
        return len(self.indices)

    def __repr__(self) -> str:
        return f"DescribedCloud(m={len(self)}, dimensions={self.descriptors.shape[1]})"


@explain_wrong_calls
def shot_lrf(
    points: CloudLike, keypoints: ArrayLike, *, radius: float, threads: int | None = None
) -> FloatArray:
    """Return the local reference frames of SHOT, usual for `si`, `cv` and `hough3d`.

    As PCL's ``SHOTLocalReferenceFrameEstimation``, after Tombari, Salti, Di Stefano, ECCV 2010. Axes are the
    eigenvectors of the scatter about the keypoint, neighbours weighted by ``radius - d``; x and z point to
    the side of most neighbours. Cost O(m k), k points per ball. Parameters are as for `shot`.

    Returns
    -------
    (m,3,3) array of float64
        Rows are the x, y and z axes, right-handed; a NaN block with fewer than 5 neighbours.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> x, y, z = features.shot_lrf(points, [500], radius=20)[0]
    >>> bool(np.allclose(np.cross(x, y), z))
    True
    """
    places = places_of(points)
    rows = places.keypoints(as_rows("keypoints", keypoints))
    return _core.shot_lrf(places.core, rows, run_options(threads), as_number("radius", radius))


@explain_wrong_calls
def toldi_lrf(
    points: CloudLike, keypoints: ArrayLike, *, radius: float, threads: int | None = None
) -> FloatArray:
    """Return TOLDI's local reference frames.

    After Yang, Zhang, Xiao, Cao, Pattern Recognition 2017. z is the plane normal of the ball of a third of
    the radius, away from its points; x is a sum of the neighbours' projections weighted by nearness and
    height. Cost O(m k), k points per ball. Parameters are as for `shot`.

    Returns
    -------
    (m,3,3) array of float64
        Rows are the x, y and z axes, right-handed; a NaN block with fewer than 4 points in the smaller
        ball or 11 in the larger, and on planes.
    """
    places = places_of(points)
    rows = places.keypoints(as_rows("keypoints", keypoints))
    return _core.toldi_lrf(places.core, rows, run_options(threads), as_number("radius", radius))


@explain_wrong_calls
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
    """Return SHOT descriptors of 352 numbers, signatures of orientation histograms.

    As PCL's ``SHOTEstimation``, after Tombari, Salti, Di Stefano, ECCV 2010. Histograms of the angle between
    the neighbours' normals and the frame's z axis, in 32 volumes of the ball. Cost O(m k), k points per ball.

    Parameters
    ----------
    points : Cloud or (N,3) array_like of float
        Finite, in any unit; make a `Cloud` of them once for several steps.
    normals : (N,3) array_like of float
        Consistently oriented; neighbours with a NaN row are left out.
    keypoints : (m,) array_like of int
        Row numbers of points.
    radius : float
        Radius of the support, a length; 15 times the `resolution` is usual.
    lrf : (m,3,3) array_like of float, optional
        Frames to use; SHOT's own of the same radius by default.
    pcl_compat : bool
        Wrap the cosine's interpolation past the last-but-one bin to the first, as PCL does.
    threads : int, optional
        Number of threads; all cores by default. The result does not depend on it.

    Returns
    -------
    (m,352) array of float32
        Rows of unit length; NaN rows without a frame or with fewer than 5 points in the ball.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> features.shot(points, features.normals(points), [0, 500], radius=20).shape
    (2, 352)
    """
    rows = as_rows("keypoints", keypoints)
    frames = None if lrf is None else real_frames("lrf", lrf, len(rows))
    places = places_of(points)
    return _core.shot(
        places.core, places.normals(real_normals("normals", normals)), places.keypoints(rows),
        run_options(threads), radius=as_number("radius", radius), lrf=frames,
        pcl_compat=as_flag("pcl_compat", pcl_compat),
    )  # fmt: skip


@explain_wrong_calls
def lfsh(
    points: CloudLike, normals: ArrayLike, keypoints: ArrayLike, *, radius: float, threads: int | None = None
) -> NDArray[np.float32]:
    """Return LFSH descriptors of 30 numbers: local feature statistics histograms.

    After Yang, Cao, Zhang, Information Sciences 2016. Histograms of local depth, horizontal distance from the
    normal's axis, and angle between normals. Cost O(m k), k points per ball. Parameters are as for `shot`.

    Returns
    -------
    (m,30) array of float32
        Three histograms, each of sum 1; zero rows with fewer than 6 points in the ball, NaN rows where the
        keypoint has no normal.
    """
    places, directions = places_of(points), real_normals("normals", normals)
    rows, size = places.keypoints(as_rows("keypoints", keypoints)), as_number("radius", radius)
    return _core.lfsh(places.core, places.normals(directions), rows, run_options(threads), size)


@explain_wrong_calls
def rcs(
    points: CloudLike, keypoints: ArrayLike, *, radius: float, threads: int | None = None
) -> NDArray[np.float32]:
    """Return RCS descriptors of 72 numbers: rotational contour signatures.

    After Yang et al., CVIU 2017. The outline of the local surface in twelve directions, seen from six sides.
    Needs no normals. Cost O(m k), k points per ball. Parameters are as for `shot`.

    Returns
    -------
    (m,72) array of float32
        Values in [0,1]; zero rows where too few points, or a plane, make no frame.
    """
    places = places_of(points)
    rows = places.keypoints(as_rows("keypoints", keypoints))
    return _core.rcs(places.core, rows, run_options(threads), as_number("radius", radius))


@explain_wrong_calls
def fpfh(
    points: CloudLike,
    normals: ArrayLike,
    keypoints: ArrayLike | None = None,
    *,
    radius: float,
    max_neighbors: int | None = 100,
    convention: Literal["open3d", "pcl"] = "open3d",
    threads: int | None = None,
) -> NDArray[np.float32]:
    """Return FPFH descriptors of 33 numbers: fast point feature histograms.

    After Rusu, Blodow, Beetz, ICRA 2009, section III. Histograms of three angles between the normals of two
    points and the line that joins them; those of the neighbours are summed up, weighted by the inverse of
    their squared distance, and scaled to 100. Cost O(N k), k points per ball; for keypoints only what lies
    around them is computed. `points` and `threads` are as for `shot`.

    Parameters
    ----------
    normals : (N,3) array_like of float
        Consistently oriented, of unit length; neighbours with a NaN row are left out.
    keypoints : (m,) array_like of int, optional
        Row numbers of points; all points by default.
    radius : float
        Radius of the support; 5 voxels is usual for a cloud thinned out by `voxel_downsample`.
    max_neighbors : int or None
        Largest number of nearest points, the point itself included (as in Open3D); None for all within the
        radius.
    convention : {"open3d", "pcl"}
        Open3D's ``compute_fpfh_feature`` adds the point's own histogram, so that each of the three sums up
        to 200; PCL's ``FPFHEstimation`` does not.

    Returns
    -------
    (m,33) array of float32
        11 bins of theta, of alpha and of phi; NaN rows where a point has no normal, zero rows where it has no
        neighbour.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> features.fpfh(points, features.normals(points), radius=8).shape
    (2554, 33)
    """
    places = places_of(points)
    found = _core.fpfh(
        places.core, places.normals(real_normals("normals", normals)),
        None if keypoints is None else places.keypoints(as_rows("keypoints", keypoints)),
        run_options(threads), radius=as_number("radius", radius), convention=convention,
        max_neighbors=None if max_neighbors is None else as_count("max_neighbors", max_neighbors, 1),
    )  # fmt: skip
    return places.spread(found) if keypoints is None else found
