"""The paper's front end: two clouds in, matches of their keypoints out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cgroup._checks.arrays import as_place
from cgroup._checks.values import as_choice, as_length
from cgroup._runtime.progress import as_stage_function
from cgroup.errors import InputError
from cgroup.features import ORIGIN
from cgroup.registration.front_end import DESCRIPTORS, FrontEnd, check_detection
from cgroup.registration.matching import match_described
from cgroup.registration.scan import NEEDED_FOR, NORMALS, as_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from cgroup.features import Cloud, Viewpoint
    from cgroup.registration.front_end import Descriptor, Detector
    from cgroup.registration.scan import Normals, Scan
    from cgroup.types import Correspondences, PointCloud

MAX_RESOLUTION_RATIO = 20.0
"""Clouds that differ more than this are taken to be in different units; descriptors would be useless."""


@dataclass(frozen=True)
class PaperFront:
    """Keypoints of a detector, described as in the evaluation of Yang et al. (2019).

    Attributes
    ----------
    detector : {"h3d", "iss"}
        Keypoint detector: Harris 3D or intrinsic shape signatures.
    descriptor : {"shot", "lfsh", "rcs", "fpfh"}
        Descriptor; the frames are always those of SHOT.
    keypoints : int or None
        How many to aim at in each cloud; None for what the detector finds at its usual radius.
    nms_radius : float or None
        Radius of the non-maximum suppression in pr; None for the detector's own.
    normals : {"pca", "mesh", "given"}
        Where normals come from: plane fits, the faces of a mesh, or the cloud itself.
    resolution : float or None
        The unit pr, in the unit of the points; None for the mean of the two clouds' resolutions.

    Raises
    ------
    InputError
        For an unknown detector, descriptor or way to find normals, or a number that is not positive.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.registration import PaperFront, register
    >>> pair = standin_pair(pixels=60)
    >>> front = PaperFront("iss", "rcs", keypoints=300)
    >>> done = register(pair.source, pair.target, front=front)
    >>> done.ok, len(done.correspondences) < 500
    (True, True)
    """

    detector: Detector = "h3d"
    descriptor: Descriptor = "shot"
    keypoints: int | None = None
    nms_radius: float | None = None
    normals: Normals = "pca"
    resolution: float | None = None

    def __post_init__(self) -> None:
        check_detection(self.detector, self.keypoints, self.nms_radius)
        as_choice("descriptor", self.descriptor, DESCRIPTORS)
        as_choice("normals", self.normals, NORMALS)
        if self.resolution is not None:
            as_length("resolution", self.resolution)


def correspond(
    source: PointCloud | Cloud | ArrayLike,
    target: PointCloud | Cloud | ArrayLike,
    *,
    detector: Detector = "h3d",
    descriptor: Descriptor = "shot",
    keypoints: int | None = None,
    nms_radius: float | None = None,
    normals: Normals = "pca",
    resolution: float | None = None,
    source_viewpoint: Viewpoint = ORIGIN,
    target_viewpoint: Viewpoint = ORIGIN,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Correspondences:
    """Match keypoints of two clouds by their descriptors.

    The front end of the evaluation by Yang et al., TPAMI 2019: every source keypoint is matched to the target
    keypoint with the nearest descriptor, right or wrong. To match one cloud with many, `describe` each once,
    at the same resolution, and `match_described` them.

    Parameters
    ----------
    source, target : PointCloud, Cloud or (N,3) array_like of float
        Whole clouds, in the same unit.
    detector : {"h3d", "iss"}
        Keypoint detector: Harris 3D or intrinsic shape signatures.
    descriptor : {"shot", "lfsh", "rcs", "fpfh"}
        Descriptor; the frames are always those of SHOT.
    keypoints : int, optional
        How many to aim at in each cloud; by default what the detector finds at its usual radius.
    nms_radius : float, optional
        Radius of the non-maximum suppression in pr; the detector's own by default.
    normals : {"pca", "mesh", "given"}
        Fit planes and turn them towards the viewpoint; or take the vertex normals of the mesh, for a cloud
        that has faces; or `PointCloud.normals`. A cloud that lacks faces, or normals, gets "pca" beside one
        that has them.
    resolution : float, optional
        The unit pr; the mean of the two clouds' resolutions by default.
    source_viewpoint, target_viewpoint : (float, float, float)
        Where the scanners stood, in their clouds' frames.
    threads : int, optional
        Threads to compute on, None for all cores.
    progress : callable, optional
        Called with the name of each stage as it begins.

    Returns
    -------
    Correspondences
        With every field that a method may need.

    Raises
    ------
    InputError
        If a cloud is too small or not finite, the clouds are in different units, neither has the faces or
        normals asked for, or an option is unknown or out of range.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> pair = standin_pair(pixels=60)
    >>> correspond(pair.source, pair.target)  # doctest: +ELLIPSIS
    Correspondences(n=..., fields=['source', 'target', 'similarity', ...])
    """
    as_choice("normals", normals, NORMALS)
    as_choice("descriptor", descriptor, DESCRIPTORS)
    front_end = FrontEnd(detector, keypoints, nms_radius, threads)
    begin = as_stage_function(progress)
    places = as_place("source_viewpoint", source_viewpoint), as_place("target_viewpoint", target_viewpoint)
    begin("resolution")
    scans = as_scan("source", source), as_scan("target", target)
    pr = common_resolution(*scans, threads) if resolution is None else scans[0].unit(resolution, threads)
    if not any(scan.has(normals) for scan in scans):
        message = f"normals: got {normals!r}, but neither cloud has {NEEDED_FOR[normals]}; choose 'pca'"
        raise InputError(message)
    described = [
        front_end.describe(
            scan,
            pr,
            descriptor,
            normals if scan.has(normals) else "pca",
            (x, y, z),
            lambda stage, role=scan.name: begin(f"{role} {stage}"),
        )
        for scan, (x, y, z) in zip(scans, places, strict=True)
    ]
    begin("matching")
    return match_described(described[0], described[1], threads=threads)


def common_resolution(source: Scan, target: Scan, threads: int | None) -> float:
    """Average the resolutions of two clouds that are in the same unit."""
    resolutions = source.resolution(threads), target.resolution(threads)
    if max(resolutions) > MAX_RESOLUTION_RATIO * min(resolutions):
        message = (
            f"source, target: their points lie {resolutions[0]:.3g} and {resolutions[1]:.3g} apart; "
            "scale them to the same unit"
        )
        raise InputError(message)
    return sum(resolutions) / 2
