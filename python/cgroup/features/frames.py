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
    """Return the local reference frames of SHOT, usual for `si`, `cv` and `hough3d`.

    As PCL's ``SHOTLocalReferenceFrameEstimation``, after Tombari, Salti, Di Stefano, ECCV 2010. Axes are the
    eigenvectors of the scatter about the keypoint, neighbours weighted by ``radius - d``; x and z point to
    the side of most neighbours. Cost O(m k), k points per ball.

    Parameters are as for `shot`.

    Returns
    -------
    (m,3,3) array of float64
        Rows are the x, y and z axes, right-handed; a NaN block where fewer than 5 neighbours make no frame.

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
    """Return TOLDI's local reference frames.

    After Yang, Zhang, Xiao, Cao, Pattern Recognition 2017. z is the plane normal of the ball of a third of
    the radius, away from its points; x is a sum of the neighbours' projections weighted by nearness and
    height. Cost O(m k), k points per ball.

    Parameters are as for `shot`.

    Returns
    -------
    (m,3,3) array of float64
        Rows are the x, y and z axes, right-handed; a NaN block with fewer than 4 points in the smaller
        ball or 11 in the larger, and on planes.
    """
    places = places_of(points)
    rows = places.keypoints(as_rows("keypoints", keypoints))
    return _core.toldi_lrf(places.core, rows, run_options(threads), as_number("radius", radius))
