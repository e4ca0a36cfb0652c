"""The front end: from a point cloud to keypoints, frames, descriptors and matches.

The steps of the paper (J. Yang, K. Xian, P. Wang, Y. Zhang, TPAMI 2019, section 4.1), each usable alone:

============  ==========================================================================
unit          `resolution`: the paper's *pr*
surface       `normals` (plane fits), `mesh_normals`
detectors     `harris3d`, `iss`; `drop_isolated` removes keypoints without support
frames        `shot_lrf`, `toldi_lrf`
descriptors   `shot` (352 numbers), `lfsh` (30), `rcs` (72), `fpfh` (33, through Open3D)
matching      `match`
============  ==========================================================================

Points are (N,3) in any unit and finite; lengths are in that unit. Keypoints are row numbers of the cloud.
"Within a radius" means nearer than it, as in PCL. All functions but `mesh_normals` and `fpfh` take
``threads`` (int or None, None for all cores); results do not depend on it. Input that can't be worked with
raises `InputError`, a `ValueError`.

>>> import numpy as np
>>> from cgroup import features
>>> rng = np.random.default_rng(0)
>>> xy = rng.uniform(size=(4000, 2))
>>> points = np.column_stack([xy, 0.1 * np.sin(9 * xy[:, 0]) * np.cos(7 * xy[:, 1])])
>>> pr = features.resolution(points)
>>> keypoints = features.harris3d(points, resolution=pr, threshold=1e-6)
>>> normals = features.normals(points, viewpoint=(0, 0, 9))
>>> descriptors = features.shot(points, normals, keypoints, radius=15 * pr)
>>> matches = features.match(descriptors, descriptors)
>>> bool((matches.source_indices == matches.target_indices).all())
True
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from cgroup import _core
from cgroup._arguments import as_count, as_floats, as_frames, as_points
from cgroup._options import run_options
from cgroup.errors import CgroupError, InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from cgroup.types import FloatArray, IndexArray

__all__ = [
    "Matches",
    "drop_isolated",
    "fpfh",
    "harris3d",
    "iss",
    "lfsh",
    "match",
    "mesh_normals",
    "normals",
    "rcs",
    "resolution",
    "shot",
    "shot_lrf",
    "toldi_lrf",
]

HARRIS_RADIUS = 2.7
"""Default radius of Harris 3D in pr, as in the paper authors' pipeline."""

ISS_RADII = (2.7, 1.8)
"""Default salient and non-maximum radius of ISS in pr, as in the paper authors' pipeline."""

SUPPORT_RADIUS = 15.0
"""Radius of descriptors and frames in pr (paper, section 4.4)."""

OPEN3D_HELP = (
    "install it with `pip install cgroup[open3d]`; on Debian and Ubuntu it also needs the packages "
    "libegl1 libgl1 libx11-6 libusb-1.0-0 libidn2-0 libudev1 libgomp1"
)


@dataclass(frozen=True, eq=False)
class Matches:
    """Nearest target descriptor of every source descriptor; row i of every field is one match.

    Attributes
    ----------
    source_indices, target_indices : (n,) array of int64
        Rows of the two descriptor tables; source rows ascend.
    distance, second_distance : (n,) array of float64
        Euclidean distance to the nearest and the second-nearest target descriptor; the second is
        infinite where there is only one.
    similarity : (n,) array of float64
        ``1 - |f_norm - f'_norm|`` on descriptors scaled to unit length, higher is better; -inf where one
        is zero (paper, section 3.1).
    ratio : (n,) array of float64
        Nearest over second-nearest distance, in [0,1], lower is better; 1 where there is no second or its
        square is at most 1e-7 (paper, section 3.1).
    """

    source_indices: IndexArray
    target_indices: IndexArray
    distance: FloatArray
    second_distance: FloatArray
    similarity: FloatArray
    ratio: FloatArray

    def __len__(self) -> int:
        return len(self.source_indices)

    def __repr__(self) -> str:
        return f"Matches(n={len(self)})"


def resolution(points: ArrayLike, *, ignore_zero: bool = False, threads: int | None = None) -> float:
    """Mean distance of a point to its nearest other point, the unit *pr* of the paper.

    Parameters
    ----------
    points : (N,3) array_like of float
        Two points or more.
    ignore_zero : bool
        Leave out points that have a duplicate; otherwise they count as 0.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    float
        A length in the unit of the points.

    Raises
    ------
    InputError
        For fewer than two points.

    Examples
    --------
    >>> resolution([[0, 0, 0], [1, 0, 0], [3, 0, 0]])
    1.3333333333333333
    """
    return _core.resolution(as_points("points", points), run_options(threads, 0, None), ignore_zero)


def normals(
    points: ArrayLike,
    *,
    neighbors: int = 20,
    radius: float | None = None,
    viewpoint: tuple[float, float, float] = (0.0, 0.0, 0.0),
    threads: int | None = None,
) -> FloatArray:
    """Fit a plane to the neighbourhood of every point (as PCL's ``NormalEstimation``).

    SHOT and LFSH depend on the side the normals point to. A viewpoint is right for a scan taken from it;
    for whole models use `mesh_normals`, or move the viewpoint along with the model. Cost O(N log N), then
    O(N neighbors).

    Parameters
    ----------
    points : (N,3) array_like of float
    neighbors : int
        Points per plane, the point itself included.
    radius : float, optional
        Use all points nearer than this instead.
    viewpoint : (float, float, float)
        Normals point to this side.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (N,3) array of float64
        Unit vectors; NaN rows where fewer than three points, or points on one line, leave the plane open.

    Examples
    --------
    >>> grid = [[x, y, 0] for x in range(5) for y in range(5)]
    >>> upwards = normals(grid, neighbors=9, viewpoint=(0, 0, 1))[:, 2]
    >>> bool((upwards > 0.999).all())
    True
    """
    place = as_floats("viewpoint", viewpoint)
    if place.shape != (3,) or not np.isfinite(place).all():
        message = f"viewpoint: got {viewpoint!r}; give three finite coordinates"
        raise InputError(message)
    as_count("neighbors", neighbors, 1)
    return _core.normals(
        as_points("points", points), run_options(threads, 0, None), neighbors, radius, place.tolist()
    )


def mesh_normals(points: ArrayLike, faces: ArrayLike) -> FloatArray:
    """Vertex normals of a triangle mesh, weighted by area and consistently oriented.

    Faces are turned alike within every connected part: outwards where the part is closed, else as most of
    its area is wound. Cost O(F log F).

    Parameters
    ----------
    points : (N,3) array_like of float
    faces : (F,3) array_like of int
        Rows of `points`.

    Returns
    -------
    (N,3) array of float64
        Unit vectors; NaN rows for points without a face.

    Examples
    --------
    >>> corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]
    >>> mesh_normals(corners, faces)[0].round(3).tolist()
    [-0.577, -0.577, -0.577]
    """
    array = np.asarray(faces)
    if array.size == 0:
        array = np.empty((0, 3), dtype=np.int64)
    if array.dtype.kind not in "iu" or array.ndim != 2 or array.shape[1] != 3:
        message = (
            f"faces: got shape {array.shape} of {array.dtype}; give (F,3) whole numbers, rows of `points`"
        )
        raise InputError(message)
    return _core.mesh_normals(as_points("points", points), array.astype(np.int64, copy=False))


def harris3d(
    points: ArrayLike,
    *,
    radius: float | None = None,
    resolution: float | None = None,
    normals: ArrayLike | None = None,
    response: Literal["harris", "noble", "lowe", "tomasi", "curvature"] = "harris",
    threshold: float = 0.0,
    nms_radius: float | None = None,
    break_ties: bool = False,
    count: int | None = None,
    threads: int | None = None,
) -> IndexArray:
    """Harris 3D keypoints (H3D): where normals vary in all directions (as PCL's ``HarrisKeypoint3D``).

    With C the mean of ``n n^T`` over the normals within `radius`, the response is
    ``0.04 + det C - 0.04 (trace C)^2``, which is 0 on planes and edges and 1/27 at most. Keypoints are
    its local maxima. Flat regions tie at 0 and all of them survive, as in PCL: raise `threshold` to 1e-6
    to be rid of them. Cost O(N k), k points per ball.

    Parameters
    ----------
    points : (N,3) array_like of float
    radius : float, optional
        Radius of normals and response; 2.7 times `resolution` by default.
    resolution : float, optional
        The unit pr; computed from the points where it is needed and not given.
    normals : (N,3) array_like of float, optional
        Normals to use; their sign does not matter, NaN rows are left out. By default planes are fitted
        within `radius`.
    response : {"harris", "noble", "lowe", "tomasi", "curvature"}
        What is maximised: the above, det C / trace C, det C / (trace C)^2, the smallest eigenvalue of C,
        or the surface variation of the plane fit.
    threshold : float
        Least response of a keypoint.
    nms_radius : float, optional
        Radius of the non-maximum suppression; `radius` by default.
    break_ties : bool
        Of equal responses keep the lowest index only.
    count : int, optional
        Change `nms_radius` by bisection until about this many keypoints remain.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (m,) array of int64
        Ascending row numbers.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = resolution(points)
    >>> usual, sparse = harris3d(points, resolution=pr), harris3d(points, resolution=pr, count=50)
    >>> len(usual) > len(sparse) > 30
    True
    """
    cloud = as_points("points", points)
    if len(cloud) == 0:
        return np.empty(0, dtype=np.int64)
    size = _length("radius", radius, HARRIS_RADIUS, cloud, resolution, threads)
    return _core.harris3d(
        cloud,
        None if normals is None else as_points("normals", normals),
        run_options(threads, 0, None),
        radius=size,
        response=response,
        threshold=threshold,
        nms_radius=size if nms_radius is None else nms_radius,
        break_ties=break_ties,
        count=None if count is None else as_count("count", count, 1),
    )


def iss(
    points: ArrayLike,
    *,
    salient_radius: float | None = None,
    nms_radius: float | None = None,
    resolution: float | None = None,
    gamma_21: float = 0.975,
    gamma_32: float = 0.975,
    min_neighbors: int = 5,
    density_weight: bool = False,
    covariance: Literal["point", "mean"] = "point",
    count: int | None = None,
    backend: Literal["cgroup", "open3d"] = "cgroup",
    threads: int | None = None,
) -> IndexArray:
    """Intrinsic shape signature keypoints (Zhong 2009; as PCL's ``ISSKeypoint3D``).

    Keypoints are local maxima of the smallest eigenvalue of a neighbourhood's scatter, where each
    eigenvalue is clearly smaller than the one before. Cost O(N k), k points per ball.

    Parameters
    ----------
    points : (N,3) array_like of float
    salient_radius : float, optional
        Radius of the scatter; 2.7 times `resolution` by default.
    nms_radius : float, optional
        Radius of the non-maximum suppression; 1.8 times `resolution` by default.
    resolution : float, optional
        The unit pr; computed from the points where it is needed and not given.
    gamma_21, gamma_32 : float
        Bounds on second / first and third / second eigenvalue.
    min_neighbors : int
        Least number of points in either ball, the point itself included.
    density_weight : bool
        Weight neighbours by the inverse of their own number of neighbours, as the original paper does.
    covariance : {"point", "mean"}
        Scatter about the point itself (PCL), or covariance about the ball's mean (Open3D).
    count : int, optional
        Change `nms_radius` by bisection until about this many keypoints remain.
    backend : {"cgroup", "open3d"}
        Open3D's own detector has the two radii, the two bounds and `min_neighbors` only, and the
        covariance about the mean.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (m,) array of int64
        Ascending row numbers.

    Raises
    ------
    CgroupError
        Where Open3D is asked for and can't be imported.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = resolution(points)
    >>> usual, sparse = iss(points, resolution=pr), iss(points, resolution=pr, nms_radius=6 * pr)
    >>> len(usual) > 3 * len(sparse)
    True
    """
    cloud = as_points("points", points)
    as_count("min_neighbors", min_neighbors, 1)
    if backend not in ("cgroup", "open3d"):
        message = f"backend: got {backend!r}; choose one of 'cgroup', 'open3d'"
        raise InputError(message)
    if len(cloud) == 0:
        return np.empty(0, dtype=np.int64)
    if resolution is None and None in (salient_radius, nms_radius):
        resolution = _resolution_of(cloud, threads)
    salient = _length("salient_radius", salient_radius, ISS_RADII[0], cloud, resolution, threads)
    nms = _length("nms_radius", nms_radius, ISS_RADII[1], cloud, resolution, threads)
    if backend == "open3d":
        _refuse_for_open3d(density_weight=density_weight, count=count)
        return _open3d_iss(cloud, salient, nms, gamma_21, gamma_32, min_neighbors)
    return _core.iss(
        cloud,
        run_options(threads, 0, None),
        salient_radius=salient,
        nms_radius=nms,
        gamma_21=gamma_21,
        gamma_32=gamma_32,
        min_neighbors=min_neighbors,
        density_weight=density_weight,
        covariance=covariance,
        count=None if count is None else as_count("count", count, 1),
    )


def drop_isolated(
    points: ArrayLike,
    keypoints: ArrayLike,
    *,
    radius: float | None = None,
    resolution: float | None = None,
    min_points: int = 10,
    threads: int | None = None,
) -> IndexArray:
    """Keep the keypoints that have enough points around them to be described.

    Parameters
    ----------
    points : (N,3) array_like of float
    keypoints : (m,) array_like of int
        Row numbers of points.
    radius : float, optional
        15 times `resolution` by default.
    resolution : float, optional
        The unit pr; computed from the points where it is needed and not given.
    min_points : int
        Least number of points nearer than `radius`, the keypoint itself included.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (k,) array of int64
        Those of `keypoints`, in their order.

    Examples
    --------
    >>> drop_isolated([[0, 0, 0], [1, 0, 0], [9, 0, 0]], [0, 2], radius=2, min_points=2).tolist()
    [0]
    """
    cloud, rows = as_points("points", points), _as_indices("keypoints", keypoints)
    if len(rows) == 0:
        return rows
    size = _length("radius", radius, SUPPORT_RADIUS, cloud, resolution, threads)
    return _core.drop_isolated(
        cloud, rows, run_options(threads, 0, None), size, as_count("min_points", min_points, 1)
    )


def shot_lrf(
    points: ArrayLike, keypoints: ArrayLike, *, radius: float, threads: int | None = None
) -> FloatArray:
    """SHOT's local reference frame (as PCL's ``SHOTLocalReferenceFrameEstimation``).

    Axes are the eigenvectors of the scatter about the keypoint, neighbours weighted by ``radius - d``;
    x and z point to the side of most neighbours. This is the default frame for `si`, `cv`, `hough3d`.

    Parameters
    ----------
    points : (N,3) array_like of float
    keypoints : (m,) array_like of int
        Row numbers of points.
    radius : float
        Radius of the support; the paper's is 15 pr.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (m,3,3) array of float64
        Rows are the x, y and z axes, right-handed; a NaN block where fewer than 5 neighbours make no frame.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = resolution(points)
    >>> frames = shot_lrf(points, [0, 500], radius=15 * pr)
    >>> frames.shape, bool(np.allclose(np.cross(frames[0, 0], frames[0, 1]), frames[0, 2]))
    ((2, 3, 3), True)
    """
    return _core.shot_lrf(
        as_points("points", points),
        _as_indices("keypoints", keypoints),
        run_options(threads, 0, None),
        radius,
    )


def toldi_lrf(
    points: ArrayLike, keypoints: ArrayLike, *, radius: float, threads: int | None = None
) -> FloatArray:
    """TOLDI's local reference frame (Yang et al., Pattern Recognition 2017).

    z is the plane normal of the ball of a third of the radius, away from its points; x is a sum of the
    neighbours' projections weighted by nearness and height.

    Parameters
    ----------
    points : (N,3) array_like of float
    keypoints : (m,) array_like of int
        Row numbers of points.
    radius : float
        Radius of the support; the paper's is 15 pr.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (m,3,3) array of float64
        Rows are the x, y and z axes, right-handed; a NaN block with fewer than 4 points in the smaller
        ball or 11 in the larger, and on planes.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = resolution(points)
    >>> toldi_lrf(points, [0, 500], radius=15 * pr).shape
    (2, 3, 3)
    """
    return _core.toldi_lrf(
        as_points("points", points),
        _as_indices("keypoints", keypoints),
        run_options(threads, 0, None),
        radius,
    )


def shot(
    points: ArrayLike,
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
    points : (N,3) array_like of float
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
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = resolution(points)
    >>> descriptors = shot(points, normals(points), [0, 500], radius=15 * pr)
    >>> descriptors.shape, np.linalg.norm(descriptors, axis=1).round(3).tolist()
    ((2, 352), [1.0, 1.0])
    """
    rows = _as_indices("keypoints", keypoints)
    frames = None if lrf is None else as_frames("lrf", lrf, len(rows))
    return _core.shot(
        as_points("points", points),
        as_points("normals", normals),
        rows,
        run_options(threads, 0, None),
        radius=radius,
        lrf=frames,
        pcl_compat=pcl_compat,
    )


def lfsh(
    points: ArrayLike,
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
    points : (N,3) array_like of float
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
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = resolution(points)
    >>> descriptors = lfsh(points, normals(points), [0, 500], radius=15 * pr)
    >>> descriptors.shape, descriptors[0, :10].sum().round(3).item()
    ((2, 30), 1.0)
    """
    return _core.lfsh(
        as_points("points", points),
        as_points("normals", normals),
        _as_indices("keypoints", keypoints),
        run_options(threads, 0, None),
        radius,
    )


def rcs(
    points: ArrayLike, keypoints: ArrayLike, *, radius: float, threads: int | None = None
) -> NDArray[np.float32]:
    """RCS-72 descriptors, rotational contour signatures (Yang et al., CVIU 2017).

    The outline of the local surface in twelve directions, seen from six sides. Needs no normals. Cost
    O(m k), k points per ball.

    Parameters
    ----------
    points : (N,3) array_like of float
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
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = resolution(points)
    >>> rcs(points, [0, 500], radius=15 * pr).shape
    (2, 72)
    """
    return _core.rcs(
        as_points("points", points),
        _as_indices("keypoints", keypoints),
        run_options(threads, 0, None),
        radius,
    )


def fpfh(
    points: ArrayLike,
    normals: ArrayLike,
    *,
    radius: float,
    max_neighbors: int | None = None,
) -> NDArray[np.float32]:
    """FPFH-33 descriptors of all points (Rusu et al., ICRA 2009), computed by Open3D.

    Needs the extra ``open3d``. Not among the paper's six combinations.

    Parameters
    ----------
    points : (N,3) array_like of float
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
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = resolution(points)
    >>> fpfh(points, normals(points), radius=15 * pr).shape  # doctest: +SKIP
    (2287, 33)
    """
    cloud, directions = as_points("points", points), as_points("normals", normals)
    if len(directions) != len(cloud):
        message = f"normals: got {len(directions)} rows; give one normal per point, here {len(cloud)}"
        raise InputError(message)
    _positive("radius", radius)
    open3d = _open3d()
    if len(cloud) == 0:
        return np.empty((0, 33), dtype=np.float32)
    parameters = open3d.geometry.KDTreeSearchParamRadius(radius)
    if max_neighbors is not None:
        limit = as_count("max_neighbors", max_neighbors, 1)
        parameters = open3d.geometry.KDTreeSearchParamHybrid(radius, limit)
    feature = open3d.pipelines.registration.compute_fpfh_feature(
        _open3d_cloud(open3d, cloud, directions), parameters
    )
    return np.ascontiguousarray(feature.data.T, dtype=np.float32)


def match(
    source: ArrayLike,
    target: ArrayLike,
    *,
    mutual: bool = False,
    max_distance: float | None = None,
    threads: int | None = None,
) -> Matches:
    """Find the nearest and second-nearest target descriptor of every source descriptor, exactly.

    Rows that are not finite are left out on both sides. Distances are Euclidean; ties take the lowest
    row. Cost O(n n' d).

    Parameters
    ----------
    source, target : (n,d), (n',d) array_like of float
        Descriptors, one row per keypoint.
    mutual : bool
        Keep a match only if the source is also the nearest of its target.
    max_distance : float, optional
        Keep a match only if its distance is at most this.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    Matches
        In the order of the source rows.

    Examples
    --------
    >>> matches = match([[0.0, 1.0], [1.0, 0.0]], [[1.0, 0.1], [0.1, 1.0]])
    >>> matches.target_indices.tolist()
    [1, 0]
    """
    fields = _core.match_descriptors(
        _as_descriptors("source", source),
        _as_descriptors("target", target),
        run_options(threads, 0, None),
        mutual,
        max_distance,
    )
    return Matches(*fields)


def _positive(name: str, value: float) -> float:
    if not 0 < value < np.inf:
        message = f"{name}: got {value}; give a finite number greater than 0"
        raise InputError(message)
    return float(value)


def _resolution_of(cloud: FloatArray, threads: int | None) -> float:
    return resolution(cloud, threads=threads)


def _length(
    name: str,
    given: float | None,
    factor: float,
    cloud: FloatArray,
    unit: float | None,
    threads: int | None,
) -> float:
    """Return the length `given`, or else `factor` times the resolution."""
    if given is not None:
        return _positive(name, given)
    if unit is not None:
        return factor * _positive("resolution", unit)
    computed = _resolution_of(cloud, threads)
    if computed == 0:
        message = f"{name}: the cloud's resolution is 0, as every point has a duplicate; give `{name}`"
        raise InputError(message)
    return factor * computed


def _as_indices(name: str, value: ArrayLike) -> IndexArray:
    array = np.asarray(value)
    if array.size == 0 and array.ndim <= 1:
        return np.empty(0, dtype=np.int64)
    if array.dtype.kind not in "iu" or array.ndim != 1:
        message = (
            f"{name}: got shape {array.shape} of {array.dtype}; give (m,) whole numbers, rows of `points`"
        )
        raise InputError(message)
    if (array < 0).any():
        row = int(np.argmax(array < 0))
        message = f"{name}: got index {array[row]} in row {row}; give rows of `points`, counted from 0"
        raise InputError(message)
    return array.astype(np.int64, copy=False)


def _as_descriptors(name: str, value: ArrayLike) -> FloatArray:
    array = as_floats(name, value)
    if array.ndim != 2 or array.shape[1] == 0:
        message = f"{name}: got shape {array.shape}; give (n,d), one descriptor per row"
        raise InputError(message)
    return array


def _open3d() -> Any:  # noqa: ANN401 - Open3D has no types
    try:
        return importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        message = f"Open3D can't be imported ({error}); {OPEN3D_HELP}"
        raise CgroupError(message) from error


def _open3d_cloud(open3d: Any, cloud: FloatArray, directions: FloatArray | None = None) -> Any:  # noqa: ANN401
    result = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(np.ascontiguousarray(cloud)))
    if directions is not None:
        result.normals = open3d.utility.Vector3dVector(np.ascontiguousarray(directions))
    return result


def _open3d_iss(
    cloud: FloatArray, salient: float, nms: float, gamma_21: float, gamma_32: float, min_neighbors: int
) -> IndexArray:
    open3d = _open3d()
    found = open3d.geometry.keypoint.compute_iss_keypoints(
        _open3d_cloud(open3d, cloud), salient, nms, gamma_21, gamma_32, min_neighbors
    )
    # Open3D gives coordinates; the lowest row that has them is the keypoint.
    rows = {tuple(point): row for row, point in reversed(list(enumerate(cloud.tolist())))}
    return np.array(sorted(rows[tuple(point)] for point in np.asarray(found.points).tolist()), dtype=np.int64)


def _refuse_for_open3d(*, density_weight: bool, count: int | None) -> None:
    for name, given in (("density_weight", density_weight), ("count", count is not None)):
        if given:
            message = f"{name}: Open3D's detector has no such option; use backend='cgroup'"
            raise InputError(message)
