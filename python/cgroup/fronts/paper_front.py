"""The front end of the paper's evaluation: keypoints of a detector, described and matched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, Literal, TypeAlias, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from cgroup import features
from cgroup._checks.arrays import as_place, in_double
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_choice, as_count, as_items, as_length, refusal
from cgroup._runtime.progress import as_stage_function, ignore_progress
from cgroup.errors import InputError
from cgroup.features import ORIGIN, SUPPORT_RADIUS, Cloud, DescribedCloud, Viewpoint
from cgroup.fronts.matching import as_correspondences
from cgroup.fronts.scan import NEEDED_FOR, NORMAL_NEIGHBORS, NORMALS, Normals, Scan, as_scan
from cgroup.types import AnyCloud, Correspondences, FloatArray, IndexArray

Detector: TypeAlias = Literal["h3d", "iss"]
Descriptor: TypeAlias = Literal["shot", "lfsh", "rcs", "fpfh"]

DETECTORS: tuple[Detector, ...] = ("h3d", "iss")
DESCRIPTORS: tuple[Descriptor, ...] = ("shot", "lfsh", "rcs", "fpfh")
MIN_SUPPORT_POINTS = 10  # points within the support of a keypoint, below which it is dropped
# Clouds that differ more than this are taken to be in different units; descriptors would be useless
MAX_RESOLUTION_RATIO = 20.0


@dataclass(frozen=True)
class PaperFront:
    """Keypoints of a detector, described as in the evaluation of Yang et al. (2019).

    Attributes
    ----------
    detector : {"h3d", "iss"}
        Keypoint detector: Harris 3D or intrinsic shape signatures.
    descriptor : {"shot", "lfsh", "rcs", "fpfh"}
        Descriptor of the keypoints; its frames are always those of SHOT.
    keypoints : int or None
        Approximate number in each cloud; None for the detector's usual radius.
    nms_radius : float or None
        Radius of the non-maximum suppression in pr; None for 2.7 (Harris 3D) or 1.8 (ISS).
    normals : {"pca", "mesh", "given"}
        Source of the normals: plane fits turned towards the viewpoint, the vertex normals of the faces, or
        `PointCloud.normals`. All descriptors but RCS need normals on the same side of the surface in both
        clouds: use "mesh" for a whole model in a scan.
    resolution : float or None
        The unit pr, in the unit of the points; None for the resolution of the cloud, or the mean of both.
        Clouds to be matched need the same.
    harris_radius : float or None
        Radius of Harris 3D in pr, for normals, response and non-maximum suppression; None for 2.7.
    iss_radii : (float, float) or None
        Radii of ISS in pr: of the scatter and of the non-maximum suppression; None for 2.7 and 1.8.
    frames : {"shot", "toldi"}
        Local reference frames of the matches; descriptors do not change.
    matching : {"nearest", "mutual"}
        Every source keypoint with the target keypoint of nearest descriptor; or only matches whose keypoints
        are each other's nearest.
    similarity : {"unit", "raw"}
        Whether the similarity of two descriptors is taken after scaling them to unit length.
    """

    detector: Detector = "h3d"
    descriptor: Descriptor = "shot"
    keypoints: int | None = None
    nms_radius: float | None = None
    normals: Normals = "pca"
    resolution: float | None = None
    _: KW_ONLY
    harris_radius: float | None = None
    iss_radii: tuple[float, float] | None = None
    frames: Literal["shot", "toldi"] = "shot"
    matching: Literal["nearest", "mutual"] = "nearest"
    similarity: Literal["unit", "raw"] = "unit"

    def __post_init__(self) -> None:
        for name, hint in get_type_hints(PaperFront).items():
            if get_origin(hint) is Literal:
                as_choice(name, getattr(self, name), get_args(hint))
        if self.keypoints is not None:
            as_count("keypoints", self.keypoints, 1)
        for name in ("nms_radius", "resolution", "harris_radius"):
            if getattr(self, name) is not None:
                as_length(name, getattr(self, name))
        if self.iss_radii is not None:
            remedy = "give two radii in pr: of the scatter, and of the non-maximum suppression"
            radii = as_items("iss_radii", self.iss_radii, remedy)
            if len(radii) != 2:
                raise refusal("iss_radii", self.iss_radii, remedy)
            for radius in radii:
                as_length("iss_radii", radius)


@explain_wrong_calls
def correspond(
    source: Cloud | AnyCloud,
    target: Cloud | AnyCloud,
    *,
    detector: Detector = "h3d",
    descriptor: Descriptor = "shot",
    keypoints: int | None = None,
    nms_radius: float | None = None,
    normals: Normals = "pca",
    resolution: float | None = None,
    viewpoint: ArrayLike = ORIGIN,
    source_viewpoint: ArrayLike | None = None,
    target_viewpoint: ArrayLike | None = None,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Correspondences:
    """Match keypoints of two clouds by their descriptors.

    The front end of the evaluation by Yang et al., TPAMI 2019: every source keypoint is matched to the target
    keypoint with the nearest descriptor. To match one cloud with many, `describe` each once at the same
    resolution, and `match_described` them. Further parameters are as for `PaperFront` and as for `register`.

    Parameters
    ----------
    source, target : PointCloud, Cloud, path or (N,3) array_like of float
        Whole clouds, in the same unit. One without the faces or normals that `normals` needs gets "pca".

    Returns
    -------
    Correspondences
        With every field that a method may need.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> pair = standin_pair(pixels=60)
    >>> correspond(pair.source, pair.target)  # doctest: +ELLIPSIS
    Correspondences(n=..., fields=['source', 'target', 'similarity', ...])
    """
    front = PaperFront(detector, descriptor, keypoints, nms_radius, normals, resolution)
    (a, b, c), (x, y, z) = (
        as_place("viewpoint", viewpoint) if own is None else as_place(name, own)
        for name, own in (("source_viewpoint", source_viewpoint), ("target_viewpoint", target_viewpoint))
    )
    return correspond_by(front, source, target, ((a, b, c), (x, y, z)), threads, as_stage_function(progress))


def correspond_by(
    front: PaperFront,
    source: Scan | Cloud | AnyCloud,
    target: Scan | Cloud | AnyCloud,
    viewpoints: tuple[Viewpoint, Viewpoint] = (ORIGIN, ORIGIN),
    threads: int | None = None,
    begin: Callable[[str], Any] = ignore_progress,
) -> Correspondences:
    """Match keypoints of two clouds; `begin` is called with the name of each stage."""
    begin("resolution")
    scans = as_scan("source", source, distinct=True), as_scan("target", target, distinct=True)
    given, normals = front.resolution, front.normals
    pr = common_resolution(*scans, threads) if given is None else scans[0].unit(given, threads)
    if not any(scan.has(normals) for scan in scans):
        lacking = f"{normals!r}, but neither cloud has {NEEDED_FOR[normals]}"
        raise InputError("normals", lacking, "choose 'pca'")
    described: list[DescribedCloud] = []
    for scan, viewpoint in zip(scans, viewpoints, strict=True):

        def begin_step(step: str, role: str = scan.name) -> None:
            begin(f"{role} {step}")

        usable = front if scan.has(normals) else replace(front, normals="pca")
        described.append(_describe(usable, scan, pr, viewpoint, threads, begin_step))
    begin("matching")
    one, other = (cloud.descriptors for cloud in described)
    matches = features.match(one, other, mutual=front.matching == "mutual", threads=threads)
    if front.similarity == "raw":
        matches = replace(matches, similarity=1 - matches.distance)
    return as_correspondences(described[0], described[1], matches)


def common_resolution(source: Scan, target: Scan, threads: int | None) -> float:
    """Return the mean resolution of two clouds in the same unit."""
    resolutions = source.resolution(threads), target.resolution(threads)
    if max(resolutions) > MAX_RESOLUTION_RATIO * min(resolutions):
        apart = f"their points lie {resolutions[0]:.3g} and {resolutions[1]:.3g} apart"
        raise InputError("source, target", remedy=f"{apart}; scale them to the same unit")
    return sum(resolutions) / 2


@explain_wrong_calls
def detect(
    cloud: Cloud | AnyCloud,
    *,
    resolution: float | None = None,
    detector: Detector = "h3d",
    keypoints: int | None = None,
    nms_radius: float | None = None,
    threads: int | None = None,
) -> IndexArray:
    """Return the keypoints with enough neighbours for a descriptor.

    The cloud is as for `describe`, options of the front as for `PaperFront`, `threads` as for `register`.

    Returns
    -------
    (m,) array of int64
        Rows of the cloud, ascending; the first of coincident points.
    """
    front = PaperFront(detector, keypoints=keypoints, nms_radius=nms_radius)
    scan = as_scan("cloud", cloud, distinct=True)
    return _rows_given(scan, _detect(front, scan, scan.unit(resolution, threads), threads))


@explain_wrong_calls
def surface_normals(
    cloud: Cloud | AnyCloud,
    *,
    normals: Normals = "pca",
    viewpoint: ArrayLike = ORIGIN,
    threads: int | None = None,
) -> FloatArray:
    """Return the normals that descriptors are computed from.

    The cloud is as for `describe`, options of the front as for `PaperFront`, `threads` as for `register`.

    Returns
    -------
    (N,3) array of float64
        Unit vectors, or as given; NaN rows for missing ones.
    """
    as_choice("normals", normals, NORMALS)
    scan = as_scan("cloud", cloud, distinct=normals != "given")
    found = _find_normals(scan, normals, viewpoint, threads)
    return found if scan.places is None else found[scan.places]


@explain_wrong_calls
def describe(
    cloud: Cloud | AnyCloud,
    *,
    resolution: float | None = None,
    detector: Detector = "h3d",
    descriptor: Descriptor = "shot",
    keypoints: int | None = None,
    nms_radius: float | None = None,
    normals: Normals = "pca",
    viewpoint: ArrayLike = ORIGIN,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> DescribedCloud:
    """Detect keypoints, and give each a frame and a descriptor.

    Further parameters are as for `PaperFront` and as for `register`.

    Parameters
    ----------
    cloud : PointCloud, Cloud, path or (N,3) array_like of float
        Whole cloud.

    Returns
    -------
    DescribedCloud
        The keypoints that have a descriptor.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> describe(standin_pair(pixels=60).source, descriptor="rcs").descriptors.shape[1]
    72
    """
    front = PaperFront(detector, descriptor, keypoints, nms_radius, normals)
    scan, begin = as_scan("cloud", cloud, distinct=True), as_stage_function(progress)
    described = _describe(front, scan, scan.unit(resolution, threads), viewpoint, threads, begin)
    return replace(described, indices=_rows_given(scan, described.indices))


def _rows_given(scan: Scan, rows: IndexArray) -> IndexArray:
    """Return rows of distinct points as rows of the input points, the first of each."""
    return rows if scan.rows is None else scan.rows[rows]


def _detect(front: PaperFront, scan: Scan, pr: float, threads: int | None) -> IndexArray:
    cloud = scan.cloud
    if front.detector == "h3d":
        size, nms = _times(pr, front.harris_radius, front.nms_radius)
        found = features.harris3d(
            cloud, radius=size, resolution=pr, nms_radius=nms, count=front.keypoints, threads=threads
        )
    else:
        salient, usual = (None, None) if front.iss_radii is None else front.iss_radii
        size, nms = _times(pr, salient, front.nms_radius or usual)
        found = features.iss(
            cloud, salient_radius=size, resolution=pr, nms_radius=nms, count=front.keypoints, threads=threads
        )
    radius, least = SUPPORT_RADIUS * pr, MIN_SUPPORT_POINTS
    return features.drop_isolated(cloud, found, radius=radius, min_points=least, threads=threads)


def _describe(
    front: PaperFront,
    scan: Scan,
    pr: float,
    viewpoint: ArrayLike,
    threads: int | None,
    begin: Callable[[str], Any],
) -> DescribedCloud:
    cloud, radius = scan.cloud, SUPPORT_RADIUS * pr
    begin("normals")
    directions = _find_normals(scan, front.normals, viewpoint, threads)
    begin("keypoints")
    found = _detect(front, scan, pr, threads)
    begin("frames")
    frames = features.shot_lrf(cloud, found, radius=radius, threads=threads)
    begin("descriptors")
    match front.descriptor:
        case "shot":
            values = features.shot(cloud, directions, found, radius=radius, lrf=frames, threads=threads)
        case "lfsh":
            values = features.lfsh(cloud, directions, found, radius=radius, threads=threads)
        case "rcs":
            values = features.rcs(cloud, found, radius=radius, threads=threads)
        case "fpfh":  # all points of the support count, as for the other descriptors
            values = features.fpfh(
                cloud, directions, found, radius=radius, max_neighbors=None, threads=threads
            )
    valid = np.isfinite(values).all(axis=1) & values.any(axis=1)
    kept, frames, points = found[valid], frames[valid], in_double(cloud.points)
    if front.frames == "toldi":
        begin("frames")
        frames = features.toldi_lrf(cloud, kept, radius=radius, threads=threads)
    return DescribedCloud(kept, points[kept], frames, values[valid], pr, points.mean(axis=0))


def _times(pr: float, *radii: float | None) -> list[float | None]:
    """Return radii in pr as lengths; None for missing ones."""
    return [None if radius is None else radius * pr for radius in radii]


def _find_normals(scan: Scan, normals: Normals, viewpoint: ArrayLike, threads: int | None) -> FloatArray:
    if not scan.has(normals):
        lacking = f"{normals!r}, but the cloud has no {NEEDED_FOR[normals]}"
        raise InputError("normals", lacking, "choose 'pca'")
    if normals == "given" and scan.normals is not None:
        if not (np.isfinite(scan.normals).all(axis=1) & scan.normals.any(axis=1)).any():
            remedy = f"all of those that came with the {scan.name} are zero or NaN; choose 'pca'"
            raise InputError("normals", remedy=remedy)
        return scan.normals
    if normals == "mesh" and scan.faces is not None:
        return features.mesh_normals(scan.cloud, scan.faces)
    return features.normals(scan.cloud, neighbors=NORMAL_NEIGHBORS, viewpoint=viewpoint, threads=threads)
