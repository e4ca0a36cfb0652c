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
from cgroup.io import PointCloud
from cgroup.methods import group
from cgroup.types import Correspondences

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from cgroup.types import FloatArray, Grouping, IndexArray

Detector: TypeAlias = Literal["h3d", "iss"]
Descriptor: TypeAlias = Literal["shot", "lfsh", "rcs"]

Normals: TypeAlias = Literal["pca", "mesh"]

DETECTORS: tuple[Detector, ...] = ("h3d", "iss")
DESCRIPTORS: tuple[Descriptor, ...] = ("shot", "lfsh", "rcs")
NORMALS: tuple[Normals, ...] = ("pca", "mesh")

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
    normals: Normals = "pca",
    source_viewpoint: Viewpoint = ORIGIN,
    target_viewpoint: Viewpoint = ORIGIN,
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
    detector, descriptor, keypoints, normals, source_viewpoint, target_viewpoint
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
        normals=normals,
        source_viewpoint=source_viewpoint,
        target_viewpoint=target_viewpoint,
        progress=clock.start,
    )
    clock.start("grouping")
    grouping = group(correspondences, method, **options)
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
    normals: Normals = "pca",
    source_viewpoint: Viewpoint = ORIGIN,
    target_viewpoint: Viewpoint = ORIGIN,
    progress: Callable[[str], Any] | None = None,
) -> Correspondences:
    """Match keypoints of two clouds by their descriptors.

    The front end of the paper's evaluation: every source keypoint is matched to the target keypoint with
    the nearest descriptor, right or wrong.

    Parameters
    ----------
    source, target : PointCloud or (N,3) array_like of float
        Whole clouds, in the same unit.
    detector : {"h3d", "iss"}
        Keypoint detector: Harris 3D or intrinsic shape signatures.
    descriptor : {"shot", "lfsh", "rcs"}
        Descriptor; the frames are always those of SHOT.
    keypoints : int, optional
        How many to aim at in each cloud; by default what the detector finds at its usual radius.
    normals : {"pca", "mesh"}
        Fit planes and turn them towards the viewpoint; or take the vertex normals of the mesh, for clouds
        that have faces. SHOT and LFSH need normals on the same side of the surface in both clouds, so for
        a whole model in a scan take "mesh".
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
    _check_choice("detector", detector, DETECTORS)
    _check_choice("descriptor", descriptor, DESCRIPTORS)
    _check_choice("normals", normals, NORMALS)
    begin = progress or _ignore
    clouds = _cloud_points("source", source), _cloud_points("target", target)
    faces = _mesh_faces(source, target) if normals == "mesh" else (None, None)
    views = source_viewpoint, target_viewpoint

    begin("resolution")
    pr = _common_resolution(*clouds)
    begin("normals")
    directions = [_normals(*cloud) for cloud in zip(clouds, faces, views, strict=True)]
    begin("keypoints")
    found = [_detect(points, detector, keypoints, pr) for points in clouds]
    begin("frames")
    frames = [
        features.shot_lrf(points, chosen, radius=SUPPORT * pr)
        for points, chosen in zip(clouds, found, strict=True)
    ]
    begin("descriptors")
    described = [
        _describe(*cloud, descriptor=descriptor, pr=pr)
        for cloud in zip(clouds, directions, found, frames, strict=True)
    ]
    begin("matching")
    (source_points, source_lrf, source_values), (target_points, target_lrf, target_values) = described
    matches = features.match(source_values, target_values)
    rows, partners = matches.source_indices, matches.target_indices
    return Correspondences(
        source_points[rows],
        target_points[partners],
        similarity=matches.similarity,
        ratio=matches.ratio,
        source_lrf=source_lrf[rows],
        target_lrf=target_lrf[partners],
        resolution=pr,
        source_centroid=clouds[0].mean(axis=0),
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


def _common_resolution(source: FloatArray, target: FloatArray) -> float:
    """Average the resolutions of two clouds that are in the same unit."""
    resolutions = features.resolution(source), features.resolution(target)
    for name, resolution in zip(("source", "target"), resolutions, strict=True):
        if resolution <= 0:
            message = f"{name}: all its points coincide with others"
            raise InputError(message)
    if max(resolutions) > MAX_RESOLUTION_RATIO * min(resolutions):
        message = (
            f"source, target: their points lie {resolutions[0]:.3g} and {resolutions[1]:.3g} apart; "
            "scale them to the same unit"
        )
        raise InputError(message)
    return sum(resolutions) / 2


def _mesh_faces(
    source: PointCloud | ArrayLike, target: PointCloud | ArrayLike
) -> tuple[IndexArray | None, IndexArray | None]:
    source_faces, target_faces = (
        cloud.faces if isinstance(cloud, PointCloud) else None for cloud in (source, target)
    )
    if source_faces is None and target_faces is None:
        message = "normals: got 'mesh', but neither cloud has faces; choose 'pca'"
        raise InputError(message)
    return source_faces, target_faces


def _normals(points: FloatArray, faces: IndexArray | None, viewpoint: Viewpoint) -> FloatArray:
    if faces is not None:
        return features.mesh_normals(points, faces)
    return features.normals(points, neighbors=NORMAL_NEIGHBORS, viewpoint=viewpoint)


def _detect(points: FloatArray, detector: Detector, count: int | None, pr: float) -> IndexArray:
    """Find the keypoints that have enough of the surface around them."""
    detect = features.harris3d if detector == "h3d" else features.iss
    found = detect(points, resolution=pr, count=count)
    return features.drop_isolated(points, found, radius=SUPPORT * pr, min_points=MIN_SUPPORT_POINTS)


def _describe(
    points: FloatArray,
    normals: FloatArray,
    keypoints: IndexArray,
    frames: FloatArray,
    *,
    descriptor: Descriptor,
    pr: float,
) -> tuple[FloatArray, FloatArray, NDArray[np.float32]]:
    """Points, frames and descriptors of the keypoints that have a descriptor."""
    radius = SUPPORT * pr
    if descriptor == "shot":
        values = features.shot(points, normals, keypoints, radius=radius, lrf=frames)
    elif descriptor == "lfsh":
        values = features.lfsh(points, normals, keypoints, radius=radius)
    else:
        values = features.rcs(points, keypoints, radius=radius)
    valid = np.isfinite(values).all(axis=1) & values.any(axis=1)
    return points[keypoints[valid]], frames[valid], values[valid]


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
