"""Local reference frames at keypoints."""

from __future__ import annotations

from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.arrays import as_rows
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.run_options import run_options
from cgroup._checks.values import as_number
from cgroup.features.cloud import CloudLike, places_of
from cgroup.types import FloatArray


@explain_wrong_calls
def shot_lrf(
    points: CloudLike, keypoints: ArrayLike, *, radius: float, threads: int | None = None
) -> FloatArray:
    """Local reference frames of SHOT, the usual ones of `si`, `cv` and `hough3d`.

    As PCL's ``SHOTLocalReferenceFrameEstimation``, after Tombari, Salti, Di Stefano, ECCV 2010. Axes are the
    eigenvectors of the scatter about the keypoint, neighbours weighted by ``radius - d``; x and z point to
    the side of most neighbours. Cost O(m k), k points per ball.

    Parameters
    ----------
    points : Cloud or (N,3) array_like of float
        Finite, in any unit; make a `Cloud` of them once for several steps.
    keypoints : (m,) array_like of int
        Row numbers of points.
    radius : float
        Radius of the support, a length; 15 times the `resolution` is usual.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.

    Returns
    -------
    (m,3,3) array of float64
        Rows are the x, y and z axes, right-handed; a NaN block where fewer than 5 neighbours make no frame.

    Raises
    ------
    InputError
        If points aren't (N,3), finite and below 1e150; for keypoints that are no rows of the points, or a
        radius that is not positive.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> frames = features.shot_lrf(points, [0, 500], radius=15 * pr)
    >>> frames.shape
    (2, 3, 3)
    >>> x, y, z = frames[0]
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
    """Local reference frames of TOLDI.

    After Yang, Zhang, Xiao, Cao, Pattern Recognition 2017. z is the plane normal of the ball of a third of
    the radius, away from its points; x is a sum of the neighbours' projections weighted by nearness and
    height. Cost O(m k), k points per ball.

    Parameters
    ----------
    points : Cloud or (N,3) array_like of float
        Finite, in any unit; make a `Cloud` of them once for several steps.
    keypoints : (m,) array_like of int
        Row numbers of points.
    radius : float
        Radius of the support, a length; 15 times the `resolution` is usual.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.

    Returns
    -------
    (m,3,3) array of float64
        Rows are the x, y and z axes, right-handed; a NaN block with fewer than 4 points in the smaller
        ball or 11 in the larger, and on planes.

    Raises
    ------
    InputError
        If points aren't (N,3), finite and below 1e150; for keypoints that are no rows of the points, or a
        radius that is not positive.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> features.toldi_lrf(points, [0, 500], radius=15 * pr).shape
    (2, 3, 3)
    """
    places = places_of(points)
    rows = places.keypoints(as_rows("keypoints", keypoints))
    return _core.toldi_lrf(places.core, rows, run_options(threads), as_number("radius", radius))
