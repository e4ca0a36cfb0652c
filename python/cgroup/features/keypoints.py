"""Keypoint detectors, and the check of each keypoint's support."""

from __future__ import annotations

import importlib
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.arrays import as_rows, in_double, real_normals, real_points
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_choice, as_count, as_flag, as_length, as_number, run_options
from cgroup.errors import CgroupError, InputError
from cgroup.features.cloud import Cloud, CloudLike, Places, places_of, resolution_of
from cgroup.types import IndexArray, RealArray

HARRIS_RADIUS = 2.7  # default radius of Harris 3D in pr, as in the paper authors' pipeline
# Default salient and non-maximum radius of ISS in pr, as in the paper authors' pipeline
ISS_RADII = (2.7, 1.8)

SUPPORT_RADIUS = 15.0
"""Radius of descriptors and frames in pr (paper, section 4.4)."""

_OPEN3D = (
    "install it with `pip install cgroup[open3d]`; on Debian and Ubuntu it also needs the packages "
    "libegl1 libgl1 libx11-6 libusb-1.0-0 libidn2-0 libudev1 libgomp1"
)


def length_or_multiple(
    name: str, given: float | None, factor: float, cloud: Places, unit: float | None, threads: int | None
) -> float:
    """Return the length `given`, or `factor` times the resolution if it is None."""
    known = None if unit is None else as_length("resolution", unit)
    if given is not None:
        return as_length(name, given)
    return factor * (resolution_of(cloud, threads) if known is None else known)


@explain_wrong_calls
def harris3d(
    points: CloudLike,
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
    """Return Harris 3D keypoints (H3D): places where normals vary in all directions.

    As PCL's ``HarrisKeypoint3D``. With C the mean of ``n n^T`` over the normals within `radius`, the response
    is ``0.04 + det C - 0.04 (trace C)^2``, which is 0 on planes and edges and 1/27 at most. Keypoints are its
    local maxima. Flat regions tie at 0 and all of them survive, as in PCL; a `threshold` of 1e-6 removes
    them. Cost O(N k), k points per ball. `points` and `threads` are as for `shot`.

    Parameters
    ----------
    radius : float, optional
        Radius of normals and response; 2.7 times `resolution` by default.
    resolution : float, optional
        Mean distance of neighbouring points, a length; computed if it is needed and not given.
    normals : (N,3) array_like of float, optional
        Normals to use; their sign does not matter, NaN rows are left out. By default planes are fitted
        within `radius`.
    response : {"harris", "noble", "lowe", "tomasi", "curvature"}
        The maximised value: the above, det C / trace C, det C / (trace C)^2, the smallest eigenvalue of C, or
        the surface variation of the plane fit.
    threshold : float
        Least response of a keypoint.
    nms_radius : float, optional
        Radius of the non-maximum suppression; `radius` by default.
    break_ties : bool
        Keep only the lowest index of equal responses.
    count : int, optional
        Change `nms_radius` by bisection until about this many keypoints remain.

    Returns
    -------
    (m,) array of int64
        Ascending row numbers.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> len(features.harris3d(points)) > len(features.harris3d(points, count=50)) > 30
    True
    """
    places = places_of(points)
    if len(places.core) == 0:
        return np.empty(0, dtype=np.int64)
    size = length_or_multiple("radius", radius, HARRIS_RADIUS, places, resolution, threads)
    found = _core.harris3d(
        places.core, None if normals is None else places.normals(real_normals("normals", normals)),
        run_options(threads), radius=size, response=response, threshold=as_number("threshold", threshold),
        nms_radius=size if nms_radius is None else as_number("nms_radius", nms_radius),
        break_ties=as_flag("break_ties", break_ties),
        count=None if count is None else as_count("count", count, 1),
    )  # fmt: skip
    return places.first_rows(found)


@explain_wrong_calls
def iss(
    points: CloudLike,
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
    """Return ISS keypoints (intrinsic shape signatures): the surface bends all ways.

    As PCL's ``ISSKeypoint3D``, after Zhong, ICCV workshops 2009. Keypoints are local maxima of the smallest
    eigenvalue of a neighbourhood's scatter, where each eigenvalue is clearly smaller than the one before.
    Cost O(N k), k points per ball. Further parameters are as for `harris3d` and as for `shot`.

    Parameters
    ----------
    salient_radius : float, optional
        Radius of the scatter; 2.7 times `resolution` by default.
    nms_radius : float, optional
        Radius of the non-maximum suppression; 1.8 times `resolution` by default.
    gamma_21, gamma_32 : float
        Bounds on second / first and third / second eigenvalue.
    min_neighbors : int
        Least number of points in either ball, the point itself included.
    density_weight : bool
        Weight neighbours by the inverse of their own number of neighbours, as the original paper does.
    covariance : {"point", "mean"}
        Scatter about the point itself (PCL), or covariance about the ball's mean (Open3D).
    backend : {"cgroup", "open3d"}
        Open3D's detector has only the two radii, the two bounds and `min_neighbors`, with the covariance
        about the mean.

    Returns
    -------
    (m,) array of int64
        Ascending row numbers.

    Raises
    ------
    CgroupError
        If the backend is Open3D, and it can't be imported.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> len(features.iss(points)) > len(features.iss(points, count=20)) > 10
    True
    """
    places = places_of(points)
    if len(places.core) == 0:
        return np.empty(0, dtype=np.int64)
    if resolution is None and (salient_radius is None or nms_radius is None):
        resolution = resolution_of(places, threads)
    salient = length_or_multiple("salient_radius", salient_radius, ISS_RADII[0], places, resolution, threads)
    nms = length_or_multiple("nms_radius", nms_radius, ISS_RADII[1], places, resolution, threads)
    if as_choice("backend", backend, ("cgroup", "open3d")) == "open3d":
        _refuse_options(density_weight=density_weight, count=count)
        given = points.points if isinstance(points, Cloud) else real_points("points", points)
        distinct = given if places.first is None else given[places.first]
        return places.first_rows(_iss_by_open3d(distinct, salient, nms, gamma_21, gamma_32, min_neighbors))
    found = _core.iss(
        places.core, run_options(threads), salient_radius=salient, nms_radius=nms, covariance=covariance,
        gamma_21=as_number("gamma_21", gamma_21), gamma_32=as_number("gamma_32", gamma_32),
        min_neighbors=as_count("min_neighbors", min_neighbors, 1),
        density_weight=as_flag("density_weight", density_weight),
        count=None if count is None else as_count("count", count, 1),
    )  # fmt: skip
    return places.first_rows(found)


@explain_wrong_calls
def drop_isolated(
    points: CloudLike,
    keypoints: ArrayLike,
    *,
    radius: float | None = None,
    resolution: float | None = None,
    min_points: int = 10,
    threads: int | None = None,
) -> IndexArray:
    """Keep the keypoints with enough neighbours for a descriptor.

    Further parameters are as for `shot` and as for `harris3d`.

    Parameters
    ----------
    radius : float, optional
        15 times `resolution` by default.
    min_points : int
        Least number of distinct points nearer than `radius`, the keypoint itself included.

    Returns
    -------
    (k,) array of int64
        Those of `keypoints`, in their order.

    Examples
    --------
    >>> from cgroup import features
    >>> points = [[0, 0, 0], [1, 0, 0], [9, 0, 0]]
    >>> features.drop_isolated(points, [0, 2], radius=2, min_points=2)
    array([0])
    """
    places, rows = places_of(points), as_rows("keypoints", keypoints)
    if len(rows) == 0:
        return rows
    size = length_or_multiple("radius", radius, SUPPORT_RADIUS, places, resolution, threads)
    least = as_count("min_points", min_points, 1)
    if places.rows is None:
        return _core.drop_isolated(places.core, rows, run_options(threads), size, least)
    # Of rows at one place all are kept or none.
    own = places.keypoints(rows)
    kept = _core.drop_isolated(places.core, own, run_options(threads), size, least)
    return rows[np.isin(own, kept)]


def _iss_by_open3d(
    points: RealArray, salient: float, nms: float, gamma_21: float, gamma_32: float, min_neighbors: int
) -> IndexArray:
    """Find Open3D's ISS keypoints, as rows of the cloud."""
    open3d = _load_open3d()
    cloud = in_double(points)
    copy = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud))
    detect = open3d.geometry.keypoint.compute_iss_keypoints
    found = detect(copy, salient, nms, gamma_21, gamma_32, min_neighbors)
    # Open3D gives coordinates; the lowest row that has them is the keypoint.
    rows = {tuple(point): row for row, point in reversed(list(enumerate(cloud.tolist())))}
    return np.array(sorted(rows[tuple(point)] for point in np.asarray(found.points).tolist()), dtype=np.int64)


def _refuse_options(*, density_weight: bool, count: int | None) -> None:
    """Raise for options of ISS that Open3D does not have."""
    for name, given in (("density_weight", density_weight), ("count", count is not None)):
        if given:
            raise InputError(name, remedy="Open3D's detector has no such option; use backend='cgroup'")


def _load_open3d() -> Any:  # noqa: ANN401 - Open3D has no types
    try:
        return importlib.import_module("open3d")
    except (ImportError, OSError) as error:
        raise CgroupError(f"Open3D can't be imported ({error}); {_OPEN3D}") from error
