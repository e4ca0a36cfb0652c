"""The pipeline: two clouds in, grouped correspondences and a pose out.

Resolution, normals, keypoints, local reference frames, descriptors, matches, group, pose: each step is
one call, so that any of them can be replaced.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from cgroup import features
from cgroup._arguments import as_points
from cgroup.errors import InputError
from cgroup.group import group
from cgroup.io import PointCloud
from cgroup.types import Correspondences, DescribedCloud

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from cgroup.types import FloatArray, Grouping, IndexArray

Detector: TypeAlias = Literal["h3d", "iss"]
Descriptor: TypeAlias = Literal["shot", "lfsh", "rcs", "fpfh"]

Normals: TypeAlias = Literal["pca", "mesh", "given"]

DETECTORS: tuple[Detector, ...] = ("h3d", "iss")
DESCRIPTORS: tuple[Descriptor, ...] = ("shot", "lfsh", "rcs", "fpfh")
NORMALS: tuple[Normals, ...] = ("pca", "mesh", "given")

_NEEDED_FOR = {"mesh": "faces", "given": "normals"}

SUPPORT = 15.0
"""Radius of descriptors and local reference frames, in pr."""

NORMAL_NEIGHBORS = 20
MIN_SUPPORT_POINTS = 10

MAX_RESOLUTION_RATIO = 20.0
"""Clouds that differ more than this are taken to be in different units; descriptors would be useless."""

Viewpoint: TypeAlias = tuple[float, float, float]
ORIGIN: Viewpoint = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Registration:
    """A source cloud placed on a target cloud.

    Attributes
    ----------
    T_target_source : (4,4) array of float64
        Least-squares pose of the group: maps source points into the target's frame, p' = R p + t.
    grouping : Grouping
        The matches that agree.
    correspondences : Correspondences
        All matches; the group's mask is aligned with them.
    seconds : dict of str to float
        Wall time of each stage, in order.
    """

    T_target_source: FloatArray
    grouping: Grouping
    correspondences: Correspondences
    seconds: dict[str, float]

    @property
    def resolution(self) -> float:
        """The unit pr: mean of the two clouds' resolutions, in the data's unit."""
        resolution = self.correspondences.resolution
        assert resolution is not None  # noqa: S101 - `correspond` always sets it
        return resolution


def register(
    source: PointCloud | ArrayLike,
    target: PointCloud | ArrayLike,
    *,
    method: str = "gtm",
    detector: Detector = "h3d",
    descriptor: Descriptor = "shot",
    keypoints: int | None = None,
    nms_radius: float | None = None,
    normals: Normals = "pca",
    source_viewpoint: Viewpoint = ORIGIN,
    target_viewpoint: Viewpoint = ORIGIN,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
    **options: Any,  # noqa: ANN401 - those of the method
) -> Registration:
    """Place a source cloud on a target cloud.

    Parameters
    ----------
    source, target : PointCloud or (N,3) array_like of float
        Whole clouds, in the same unit.
    method : str
        Grouping method, one of `cgroup.METHODS`.
    detector, descriptor, keypoints, nms_radius, normals, source_viewpoint, target_viewpoint, threads
        See `correspond`.
    progress : callable, optional
        Called with the name of each stage as it begins.
    **options
        Options of the grouping method.

    Returns
    -------
    Registration
        Pose, group and matches.

    Raises
    ------
    NoConsensusError
        If the group doesn't fix a pose.
    InputError
        If a cloud or an option can't be worked with.
    """
    clock = _Clock(progress)
    correspondences = correspond(
        source,
        target,
        detector=detector,
        descriptor=descriptor,
        keypoints=keypoints,
        nms_radius=nms_radius,
        normals=normals,
        source_viewpoint=source_viewpoint,
        target_viewpoint=target_viewpoint,
        threads=threads,
        progress=clock.start,
    )
    clock.start("grouping")
    grouping = group(correspondences, method, threads=threads, **options)
    clock.start("pose")
    pose = grouping.transform()
    clock.stop()
    return Registration(pose, grouping, correspondences, clock.seconds)


def correspond(
    source: PointCloud | ArrayLike,
    target: PointCloud | ArrayLike,
    *,
    detector: Detector = "h3d",
    descriptor: Descriptor = "shot",
    keypoints: int | None = None,
    nms_radius: float | None = None,
    normals: Normals = "pca",
    source_viewpoint: Viewpoint = ORIGIN,
    target_viewpoint: Viewpoint = ORIGIN,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Correspondences:
    """Match keypoints of two clouds by their descriptors.

    The front end of the paper's evaluation: every source keypoint is matched to the target keypoint with
    the nearest descriptor, right or wrong. To match one cloud with many, `describe` each once, at the same
    resolution, and `match_described` them.

    Parameters
    ----------
    source, target : PointCloud or (N,3) array_like of float
        Whole clouds, in the same unit.
    detector, descriptor, keypoints, nms_radius, threads
        See `describe`.
    normals : {"pca", "mesh", "given"}
        As in `describe`; a cloud that lacks faces, or normals, gets "pca" beside one that has them.
    source_viewpoint, target_viewpoint : (float, float, float)
        Where the scanners stood, in their clouds' frames.
    progress : callable, optional
        Called with the name of each stage as it begins.

    Returns
    -------
    Correspondences
        With every field that a method may need.

    Raises
    ------
    InputError
        If a cloud is too small or not finite, the clouds are in different units, or an option is unknown.
    """
    _check_choice("normals", normals, NORMALS)
    begin = progress or _ignore
    begin("resolution")
    pr = _common_resolution(_cloud_points("source", source), _cloud_points("target", target), threads)
    possible = [_has_normals(cloud, normals) for cloud in (source, target)]
    if not any(possible):
        message = f"normals: got {normals!r}, but neither cloud has {_NEEDED_FOR[normals]}; choose 'pca'"
        raise InputError(message)
    described = [
        describe(
            cloud,
            resolution=pr,
            detector=detector,
            descriptor=descriptor,
            keypoints=keypoints,
            nms_radius=nms_radius,
            normals=normals if has_normals else "pca",
            viewpoint=viewpoint,
            threads=threads,
            progress=lambda stage, role=role: begin(f"{role} {stage}"),
        )
        for role, cloud, has_normals, viewpoint in zip(
            ("source", "target"),
            (source, target),
            possible,
            (source_viewpoint, target_viewpoint),
            strict=True,
        )
    ]
    begin("matching")
    return match_described(described[0], described[1], threads=threads)


def detect(
    cloud: PointCloud | ArrayLike,
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
    cloud : PointCloud or (N,3) array_like of float
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
    """
    _check_choice("detector", detector, DETECTORS)
    points = _cloud_points("cloud", cloud)
    pr = _unit(points, resolution, threads)
    find = features.harris3d if detector == "h3d" else features.iss
    suppression = None if nms_radius is None else _length("nms_radius", nms_radius) * pr
    found = find(points, resolution=pr, nms_radius=suppression, count=keypoints, threads=threads)
    return features.drop_isolated(
        points, found, radius=SUPPORT * pr, min_points=MIN_SUPPORT_POINTS, threads=threads
    )


def surface_normals(
    cloud: PointCloud | ArrayLike,
    *,
    normals: Normals = "pca",
    viewpoint: Viewpoint = ORIGIN,
    threads: int | None = None,
) -> FloatArray:
    """Find the normals that descriptors are made with.

    Parameters
    ----------
    cloud, normals, viewpoint, threads
        See `describe`.

    Returns
    -------
    (N,3) array of float64
        Unit vectors, or as given; NaN rows where there is none.

    Raises
    ------
    InputError
        If the cloud lacks the faces or normals asked for, or `normals` is unknown.
    """
    _check_choice("normals", normals, NORMALS)
    if not _has_normals(cloud, normals):
        message = f"normals: got {normals!r}, but the cloud has no {_NEEDED_FOR[normals]}; choose 'pca'"
        raise InputError(message)
    if isinstance(cloud, PointCloud) and normals == "given" and cloud.normals is not None:
        return cloud.normals
    if isinstance(cloud, PointCloud) and normals == "mesh" and cloud.faces is not None:
        return features.mesh_normals(cloud.points, cloud.faces)
    points = _cloud_points("cloud", cloud)
    return features.normals(points, neighbors=NORMAL_NEIGHBORS, viewpoint=viewpoint, threads=threads)


def describe(
    cloud: PointCloud | ArrayLike,
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
    cloud : PointCloud or (N,3) array_like of float
        Whole cloud.
    resolution, detector, keypoints, nms_radius, threads
        See `detect`.
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
    """
    _check_choice("detector", detector, DETECTORS)
    _check_choice("descriptor", descriptor, DESCRIPTORS)
    begin = progress or _ignore
    points = _cloud_points("cloud", cloud)
    pr = _unit(points, resolution, threads)
    begin("normals")
    directions = surface_normals(cloud, normals=normals, viewpoint=viewpoint, threads=threads)
    begin("keypoints")
    found = detect(
        points,
        resolution=pr,
        detector=detector,
        keypoints=keypoints,
        nms_radius=nms_radius,
        threads=threads,
    )
    begin("frames")
    frames = features.shot_lrf(points, found, radius=SUPPORT * pr, threads=threads)
    begin("descriptors")
    values = _descriptors(points, directions, found, frames, descriptor, SUPPORT * pr, threads)
    valid = np.isfinite(values).all(axis=1) & values.any(axis=1)
    kept = found[valid]
    return DescribedCloud(kept, points[kept], frames[valid], values[valid], pr, points.mean(axis=0))


def match_described(
    source: DescribedCloud, target: DescribedCloud, *, threads: int | None = None
) -> Correspondences:
    """Match every source keypoint with the target keypoint whose descriptor is nearest.

    Parameters
    ----------
    source, target : DescribedCloud
        Described alike; the resolution of the matches is the mean of theirs.
    threads : int, optional
        Threads to compute on, None for all cores.

    Returns
    -------
    Correspondences
        With every field that a method may need.

    Raises
    ------
    InputError
        If the descriptors are not of the same kind.
    """
    matches = features.match(source.descriptors, target.descriptors, threads=threads)
    rows, partners = matches.source_indices, matches.target_indices
    return Correspondences(
        source.points[rows],
        target.points[partners],
        similarity=matches.similarity,
        ratio=matches.ratio,
        source_lrf=source.lrf[rows],
        target_lrf=target.lrf[partners],
        resolution=(source.resolution + target.resolution) / 2,
        source_centroid=source.centroid,
    )


def _cloud_points(name: str, cloud: PointCloud | ArrayLike) -> FloatArray:
    points = as_points(name, cloud.points if isinstance(cloud, PointCloud) else cloud)
    if len(points) <= NORMAL_NEIGHBORS:
        message = f"{name}: got {len(points)} points; descriptors need more than {NORMAL_NEIGHBORS}"
        raise InputError(message)
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        message = f"{name}: row {row} isn't finite; drop such rows first"
        raise InputError(message)
    return points


def _resolution(name: str, points: FloatArray, threads: int | None) -> float:
    resolution = features.resolution(points, threads=threads)
    if resolution <= 0:
        message = f"{name}: all its points coincide with others"
        raise InputError(message)
    return resolution


def _unit(points: FloatArray, given: float | None, threads: int | None) -> float:
    """Return the unit pr: the one given, or that of the cloud."""
    if given is None:
        return _resolution("cloud", points, threads)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    if _length("resolution", given) > size:
        message = (
            f"resolution: got {given}, but the whole cloud is {size:.3g} across; give it in the cloud's unit"
        )
        raise InputError(message)
    return given


def _length(name: str, length: float) -> float:
    if not 0 < length < np.inf:
        message = f"{name}: got {length}; give a finite length greater than 0"
        raise InputError(message)
    return length


def _common_resolution(source: FloatArray, target: FloatArray, threads: int | None) -> float:
    """Average the resolutions of two clouds that are in the same unit."""
    resolutions = _resolution("source", source, threads), _resolution("target", target, threads)
    if max(resolutions) > MAX_RESOLUTION_RATIO * min(resolutions):
        message = (
            f"source, target: their points lie {resolutions[0]:.3g} and {resolutions[1]:.3g} apart; "
            "scale them to the same unit"
        )
        raise InputError(message)
    return sum(resolutions) / 2


def _has_normals(cloud: PointCloud | ArrayLike, normals: Normals) -> bool:
    if normals == "pca":
        return True
    return isinstance(cloud, PointCloud) and getattr(cloud, _NEEDED_FOR[normals]) is not None


def _descriptors(
    points: FloatArray,
    normals: FloatArray,
    keypoints: IndexArray,
    frames: FloatArray,
    descriptor: Descriptor,
    radius: float,
    threads: int | None,
) -> NDArray[np.float32]:
    match descriptor:
        case "shot":
            return features.shot(points, normals, keypoints, radius=radius, lrf=frames, threads=threads)
        case "lfsh":
            return features.lfsh(points, normals, keypoints, radius=radius, threads=threads)
        case "rcs":
            return features.rcs(points, keypoints, radius=radius, threads=threads)
        case "fpfh":
            return features.fpfh(points, normals, radius=radius)[keypoints]


def _ignore(_stage: str) -> None:
    """Stands in for a progress callback."""


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        message = f"{name}: got {value!r}; choose one of {', '.join(choices)}"
        raise InputError(message)


class _Clock:
    """Takes the time of stages and passes on their names."""

    def __init__(self, progress: Callable[[str], Any] | None) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress
        self._stage: str | None = None
        self._since = 0.0

    def start(self, stage: str) -> None:
        self.stop()
        if self._progress is not None:
            self._progress(stage)
        self._stage, self._since = stage, time.perf_counter()

    def stop(self) -> None:
        if self._stage is not None:
            self.seconds[self._stage] = time.perf_counter() - self._since
        self._stage = None
