"""From a cloud to keypoints with frames and descriptors."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cgroup._checks.values import as_choice
from cgroup._runtime.progress import as_stage_function
from cgroup.features import ORIGIN
from cgroup.registration.front_end import DESCRIPTORS, FrontEnd, find_normals
from cgroup.registration.scan import NORMALS, as_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from cgroup.features import Cloud, DescribedCloud, Viewpoint
    from cgroup.registration.front_end import Descriptor, Detector
    from cgroup.registration.scan import Normals
    from cgroup.types import FloatArray, IndexArray, PointCloud


def detect(
    cloud: PointCloud | Cloud | ArrayLike,
    *,
    resolution: float | None = None,
    detector: Detector = "h3d",
    keypoints: int | None = None,
    nms_radius: float | None = None,
    threads: int | None = None,
) -> IndexArray:
    """Find the keypoints that have enough of the surface around them to be described.

    Parameters
    ----------
    cloud : PointCloud, Cloud or (N,3) array_like of float
        Whole cloud.
    resolution : float, optional
        The unit pr; that of the cloud by default. Clouds to be matched need the same.
    detector : {"h3d", "iss"}
        Keypoint detector: Harris 3D or intrinsic shape signatures.
    keypoints : int, optional
        How many to aim at; by default what the detector finds at its usual radius.
    nms_radius : float, optional
        Radius of the non-maximum suppression in pr; the detector's own by default (2.7 for Harris 3D, 1.8
        for ISS).
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (m,) array of int64
        Rows of the cloud, ascending.

    Raises
    ------
    InputError
        If the cloud is too small or not finite, or an option is unknown or out of range.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> cloud = standin_pair(pixels=60).source
    >>> len(detect(cloud)) > len(detect(cloud, keypoints=50)) > 30
    True
    """
    front_end, scan = FrontEnd(detector, keypoints, nms_radius, threads), as_scan("cloud", cloud)
    return front_end.detect(scan, scan.unit(resolution, threads))


def surface_normals(
    cloud: PointCloud | Cloud | ArrayLike,
    *,
    normals: Normals = "pca",
    viewpoint: Viewpoint = ORIGIN,
    threads: int | None = None,
) -> FloatArray:
    """Find the normals that descriptors are made with.

    Parameters
    ----------
    cloud : PointCloud, Cloud or (N,3) array_like of float
        Whole cloud.
    normals : {"pca", "mesh", "given"}
        Fit planes and turn them towards the viewpoint; or take the vertex normals of the mesh, for a cloud
        that has faces; or `PointCloud.normals`.
    viewpoint : (float, float, float)
        Where the scanner stood, in the cloud's frame.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    (N,3) array of float64
        Unit vectors, or as given; NaN rows where there is none.

    Raises
    ------
    InputError
        If the cloud isn't (N,3) and finite or lacks the faces or normals asked for, `normals` is unknown, or
        the viewpoint isn't three numbers.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.datasets import standin_pair
    >>> pair = standin_pair(pixels=60)
    >>> normals = surface_normals(pair.source, viewpoint=pair.source_viewpoint)
    >>> towards = pair.source_viewpoint - pair.source.points
    >>> bool((np.sum(normals * towards, axis=1) >= 0).all())
    True
    """
    as_choice("normals", normals, NORMALS)
    return find_normals(as_scan("cloud", cloud), normals, viewpoint, threads)


def describe(
    cloud: PointCloud | Cloud | ArrayLike,
    *,
    resolution: float | None = None,
    detector: Detector = "h3d",
    descriptor: Descriptor = "shot",
    keypoints: int | None = None,
    nms_radius: float | None = None,
    normals: Normals = "pca",
    viewpoint: Viewpoint = ORIGIN,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> DescribedCloud:
    """Detect keypoints, and give each a frame and a descriptor.

    Parameters
    ----------
    cloud : PointCloud, Cloud or (N,3) array_like of float
        Whole cloud.
    resolution : float, optional
        The unit pr, a length; that of the cloud by default. Clouds to be matched need the same.
    detector : {"h3d", "iss"}
        Keypoint detector: Harris 3D or intrinsic shape signatures.
    descriptor : {"shot", "lfsh", "rcs", "fpfh"}
        Descriptor; the frames are always those of SHOT.
    keypoints : int, optional
        How many to aim at; by default what the detector finds at its usual radius.
    nms_radius : float, optional
        Radius of the non-maximum suppression in pr; the detector's own by default (2.7 for Harris 3D, 1.8
        for ISS).
    normals : {"pca", "mesh", "given"}
        Fit planes and turn them towards the viewpoint; or take the vertex normals of the mesh, for a cloud
        that has faces; or `PointCloud.normals`. All descriptors but RCS need normals on the same side of the
        surface in both clouds, so for a whole model in a scan take "mesh".
    viewpoint : (float, float, float)
        Where the scanner stood, in the cloud's frame.
    threads : int, optional
        Threads to compute on, None for all cores.
    progress : callable, optional
        Called with the name of each stage as it begins.

    Returns
    -------
    DescribedCloud
        The keypoints that have a descriptor.

    Raises
    ------
    InputError
        If the cloud is too small, not finite or without the faces or normals asked for, or an option is
        unknown or out of range.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> describe(standin_pair(pixels=60).source, descriptor="rcs").descriptors.shape[1]
    72
    """
    as_choice("descriptor", descriptor, DESCRIPTORS)
    as_choice("normals", normals, NORMALS)
    front_end, scan = FrontEnd(detector, keypoints, nms_radius, threads), as_scan("cloud", cloud)
    pr = scan.unit(resolution, threads)
    return front_end.describe(scan, pr, descriptor, normals, viewpoint, as_stage_function(progress))
