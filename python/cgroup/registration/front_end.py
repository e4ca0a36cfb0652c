"""The steps from a cloud that is ready to keypoints with frames and descriptors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from cgroup import features
from cgroup._checks.arrays import in_double
from cgroup._checks.values import as_choice, as_count, as_length
from cgroup.errors import InputError
from cgroup.features import SUPPORT_RADIUS, DescribedCloud
from cgroup.registration.scan import NEEDED_FOR, NORMAL_NEIGHBORS

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from cgroup.features import Cloud, Viewpoint
    from cgroup.registration.scan import Normals, Scan
    from cgroup.types import FloatArray, IndexArray

Detector: TypeAlias = Literal["h3d", "iss"]
Descriptor: TypeAlias = Literal["shot", "lfsh", "rcs", "fpfh"]

DETECTORS: tuple[Detector, ...] = ("h3d", "iss")
DESCRIPTORS: tuple[Descriptor, ...] = ("shot", "lfsh", "rcs", "fpfh")

MIN_SUPPORT_POINTS = 10


@dataclass(frozen=True)
class FrontEnd:
    """How keypoints are found; clouds that are to be matched need the same. Radii are in pr."""

    detector: Detector
    keypoints: int | None
    nms_radius: float | None
    threads: int | None
    harris_radius: float | None = None
    iss_radii: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        check_detection(self.detector, self.keypoints, self.nms_radius)

    def detect(self, scan: Scan, pr: float) -> IndexArray:
        """Find the keypoints that have enough support, with the unit `pr`."""
        cloud, threads = scan.cloud, self.threads
        if self.detector == "h3d":
            size, nms = _times(pr, self.harris_radius, self.nms_radius)
            found = features.harris3d(
                cloud, radius=size, resolution=pr, nms_radius=nms, count=self.keypoints, threads=threads
            )
        else:
            salient, usual = self.iss_radii or (None, None)
            size, nms = _times(pr, salient, self.nms_radius or usual)
            found = features.iss(
                cloud,
                salient_radius=size,
                resolution=pr,
                nms_radius=nms,
                count=self.keypoints,
                threads=threads,
            )
        radius, least = SUPPORT_RADIUS * pr, MIN_SUPPORT_POINTS
        return features.drop_isolated(cloud, found, radius=radius, min_points=least, threads=threads)

    def describe(
        self,
        scan: Scan,
        pr: float,
        descriptor: Descriptor,
        normals: Normals,
        viewpoint: Viewpoint,
        begin: Callable[[str], Any],
    ) -> DescribedCloud:
        """Detect keypoints, and give each a frame and a descriptor."""
        cloud, radius, threads = scan.cloud, SUPPORT_RADIUS * pr, self.threads
        begin("normals")
        directions = find_normals(scan, normals, viewpoint, threads)
        begin("keypoints")
        found = self.detect(scan, pr)
        begin("frames")
        frames = features.shot_lrf(cloud, found, radius=radius, threads=threads)
        begin("descriptors")
        values = _describe(cloud, directions, found, frames, descriptor, radius, threads)
        valid = np.isfinite(values).all(axis=1) & values.any(axis=1)
        kept, points = found[valid], in_double(cloud.points)
        return DescribedCloud(kept, points[kept], frames[valid], values[valid], pr, points.mean(axis=0))


def _times(pr: float, *radii: float | None) -> list[float | None]:
    """Return radii in pr as lengths; None where there is none."""
    return [None if radius is None else radius * pr for radius in radii]


def check_detection(detector: str, keypoints: int | None, nms_radius: float | None) -> None:
    """Refuse what a detector can't work with."""
    as_choice("detector", detector, DETECTORS)
    if keypoints is not None:
        as_count("keypoints", keypoints, 1)
    if nms_radius is not None:
        as_length("nms_radius", nms_radius)


def find_normals(scan: Scan, normals: Normals, viewpoint: Viewpoint, threads: int | None) -> FloatArray:
    """Find the normals of a cloud that is ready."""
    if not scan.has(normals):
        message = f"normals: got {normals!r}, but the cloud has no {NEEDED_FOR[normals]}; choose 'pca'"
        raise InputError(message)
    if normals == "given" and scan.normals is not None:
        if not (np.isfinite(scan.normals).all(axis=1) & scan.normals.any(axis=1)).any():
            message = f"normals: all of those that came with the {scan.name} are zero or NaN; choose 'pca'"
            raise InputError(message)
        return scan.normals
    if normals == "mesh" and scan.faces is not None:
        return features.mesh_normals(scan.cloud, scan.faces)
    return features.normals(scan.cloud, neighbors=NORMAL_NEIGHBORS, viewpoint=viewpoint, threads=threads)


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
            # All points of the support count, as for the other descriptors.
            return features.fpfh(
                cloud, normals, keypoints, radius=radius, max_neighbors=None, threads=threads
            )
