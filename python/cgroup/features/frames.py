"""Local reference frames at keypoints."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup import _core
from cgroup._arguments import as_rows
from cgroup._options import run_options
from cgroup._values import as_number
from cgroup.features.cloud import core_cloud

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.features.cloud import CloudLike
    from cgroup.types import FloatArray


def shot_lrf(
    points: CloudLike, keypoints: ArrayLike, *, radius: float, threads: int | None = None
) -> FloatArray:
    """SHOT's local reference frame (as PCL's ``SHOTLocalReferenceFrameEstimation``).

    Axes are the eigenvectors of the scatter about the keypoint, neighbours weighted by ``radius - d``;
    x and z point to the side of most neighbours. This is the default frame for `si`, `cv`, `hough3d`.

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
    >>> frames.shape, bool(np.allclose(np.cross(frames[0, 0], frames[0, 1]), frames[0, 2]))
    ((2, 3, 3), True)
    """
    return _core.shot_lrf(
        core_cloud(points),
        as_rows("keypoints", keypoints),
        run_options(threads),
        as_number("radius", radius),
    )


def toldi_lrf(
    points: CloudLike, keypoints: ArrayLike, *, radius: float, threads: int | None = None
) -> FloatArray:
    """TOLDI's local reference frame (Yang et al., Pattern Recognition 2017).

    z is the plane normal of the ball of a third of the radius, away from its points; x is a sum of the
    neighbours' projections weighted by nearness and height.

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
    (m,3,3) array of float64
        Rows are the x, y and z axes, right-handed; a NaN block with fewer than 4 points in the smaller
        ball or 11 in the larger, and on planes.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> features.toldi_lrf(points, [0, 500], radius=15 * pr).shape
    (2, 3, 3)
    """
    return _core.toldi_lrf(
        core_cloud(points),
        as_rows("keypoints", keypoints),
        run_options(threads),
        as_number("radius", radius),
    )
