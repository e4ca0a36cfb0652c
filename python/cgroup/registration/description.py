"""From a cloud to keypoints with frames and descriptors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from cgroup import features
from cgroup._arguments import in_double
from cgroup._progress import ignore_progress
from cgroup.errors import InputError
from cgroup.features import ORIGIN, SUPPORT_RADIUS, DescribedCloud
from cgroup.registration.scan import (
    NEEDED_FOR,
    NORMAL_NEIGHBORS,
    NORMALS,
    as_scan,
    check_choice,
    checked_length,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from cgroup.features import Cloud, Viewpoint
    from cgroup.registration.scan import Normals, Scan
    from cgroup.types import FloatArray, IndexArray, PointCloud

Detector: TypeAlias = Literal["h3d", "iss"]
Descriptor: TypeAlias = Literal["shot", "lfsh", "rcs", "fpfh"]

DETECTORS: tuple[Detector, ...] = ("h3d", "iss")
DESCRIPTORS: tuple[Descriptor, ...] = ("shot", "lfsh", "rcs", "fpfh")

MIN_SUPPORT_POINTS = 10


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

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> cloud = standin_pair(pixels=60).source
    >>> len(detect(cloud)) > len(detect(cloud, keypoints=50)) > 30
    True
    """
    check_choice("detector", detector, DETECTORS)
    scan = as_scan("cloud", cloud)
    return _detect(scan.cloud, scan.unit(resolution, threads), detector, keypoints, nms_radius, threads)


def _detect(
    cloud: Cloud,
    pr: float,
    detector: Detector,
    keypoints: int | None,
    nms_radius: float | None,
    threads: int | None,
) -> IndexArray:
    suppression = None if nms_radius is None else checked_length("nms_radius", nms_radius) * pr
    find = features.harris3d if detector == "h3d" else features.iss
    found = find(cloud, resolution=pr, nms_radius=suppression, count=keypoints, threads=threads)
    return features.drop_isolated(
        cloud, found, radius=SUPPORT_RADIUS * pr, min_points=MIN_SUPPORT_POINTS, threads=threads
    )


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
        If the cloud lacks the faces or normals asked for, or `normals` is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.datasets import standin_pair
    >>> pair = standin_pair(pixels=60)
    >>> towards = surface_normals(pair.source, viewpoint=pair.source_viewpoint)
    >>> bool((np.sum(towards * (pair.source_viewpoint - pair.source.points), axis=1) >= 0).all())
    True
    """
    check_choice("normals", normals, NORMALS)
    return find_normals(as_scan("cloud", cloud), normals, viewpoint, threads)


def find_normals(scan: Scan, normals: Normals, viewpoint: Viewpoint, threads: int | None) -> FloatArray:
    """Find the normals of a cloud that is ready."""
    if not scan.has(normals):
        message = f"normals: got {normals!r}, but the cloud has no {NEEDED_FOR[normals]}; choose 'pca'"
        raise InputError(message)
    if normals == "given" and scan.normals is not None:
        return scan.normals
    if normals == "mesh" and scan.faces is not None:
        return features.mesh_normals(scan.cloud, scan.faces)
    return features.normals(scan.cloud, neighbors=NORMAL_NEIGHBORS, viewpoint=viewpoint, threads=threads)


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
        The unit pr; that of the cloud by default. Clouds to be matched need the same.
    detector : {"h3d", "iss"}
        Keypoint detector: Harris 3D or intrinsic shape signatures.
    keypoints : int, optional
        How many to aim at; by default what the detector finds at its usual radius.
    nms_radius : float, optional
        Radius of the non-maximum suppression in pr; the detector's own by default.
    threads : int, optional
        Threads to compute on, None for all cores.
    descriptor : {"shot", "lfsh", "rcs", "fpfh"}
        Descriptor; the frames are always those of SHOT. FPFH needs the extra ``open3d``.
    normals : {"pca", "mesh", "given"}
        Fit planes and turn them towards the viewpoint; or take the vertex normals of the mesh, for a cloud
        that has faces; or `PointCloud.normals`. All descriptors but RCS need normals on the same side of the
        surface in both clouds, so for a whole model in a scan take "mesh".
    viewpoint : (float, float, float)
        Where the scanner stood, in the cloud's frame.
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
        unknown.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> describe(standin_pair(pixels=60).source, descriptor="rcs").descriptors.shape[1]
    72
    """
    check_choice("detector", detector, DETECTORS)
    check_choice("descriptor", descriptor, DESCRIPTORS)
    check_choice("normals", normals, NORMALS)
    front_end = FrontEnd(detector, descriptor, keypoints, nms_radius, threads)
    scan = as_scan("cloud", cloud)
    pr = scan.unit(resolution, threads)
    return front_end.describe(scan, pr, normals, viewpoint, progress or ignore_progress)


@dataclass(frozen=True)
class FrontEnd:
    """How clouds that are to be matched are described alike."""

    detector: Detector
    descriptor: Descriptor
    keypoints: int | None
    nms_radius: float | None
    threads: int | None

    def describe(
        self, scan: Scan, pr: float, normals: Normals, viewpoint: Viewpoint, begin: Callable[[str], Any]
    ) -> DescribedCloud:
        """Describe a cloud that is ready, with the unit `pr`."""
        begin("normals")
        directions = find_normals(scan, normals, viewpoint, self.threads)
        begin("keypoints")
        cloud, threads = scan.cloud, self.threads
        found = _detect(cloud, pr, self.detector, self.keypoints, self.nms_radius, threads)
        begin("frames")
        frames = features.shot_lrf(cloud, found, radius=SUPPORT_RADIUS * pr, threads=threads)
        begin("descriptors")
        values = _describe(cloud, directions, found, frames, self.descriptor, SUPPORT_RADIUS * pr, threads)
        valid = np.isfinite(values).all(axis=1) & values.any(axis=1)
        kept, points = found[valid], in_double(cloud.points)
        return DescribedCloud(kept, points[kept], frames[valid], values[valid], pr, points.mean(axis=0))


def _describe(
    cloud: Cloud,
    normals: FloatArray,
    keypoints: IndexArray,
    frames: FloatArray,
    descriptor: Descriptor,
    radius: float,
    threads: int | None,
) -> NDArray[np.float32]:
    match descriptor:
        case "shot":
            return features.shot(cloud, normals, keypoints, radius=radius, lrf=frames, threads=threads)
        case "lfsh":
            return features.lfsh(cloud, normals, keypoints, radius=radius, threads=threads)
        case "rcs":
            return features.rcs(cloud, keypoints, radius=radius, threads=threads)
        case "fpfh":
            return features.fpfh(cloud, normals, radius=radius)[keypoints]
