"""Matches by another front end than the paper's: the steps of `correspond`, with what a case changes."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from cgroup import features
from cgroup.benchmark.cases import COMBINATIONS
from cgroup.benchmark.config import FrontEntry
from cgroup.features import ORIGIN, SUPPORT_RADIUS
from cgroup.registration.correspond import common_resolution
from cgroup.registration.front_end import FrontEnd
from cgroup.registration.matching import as_correspondences
from cgroup.registration.scan import as_scan

if TYPE_CHECKING:
    from collections.abc import Callable

    from cgroup.benchmark.cases import Case
    from cgroup.datasets import MatchingPair
    from cgroup.features import DescribedCloud
    from cgroup.registration.scan import Scan
    from cgroup.types import Correspondences, PointCloud

_THREADS = 1  # workers compute on one


def read_front(case: Case) -> FrontEntry:
    """Read what a case changes of the front end."""
    return FrontEntry.model_validate_json(case.front or "{}")


def match_by_front(
    case: Case,
    clouds: tuple[PointCloud, PointCloud],
    undisturbed: MatchingPair,
    begin: Callable[[str], Any],
) -> Correspondences:
    """Match two clouds by the front end of a case.

    Parameters
    ----------
    case : Case
        Says how.
    clouds : (PointCloud, PointCloud)
        Source and target as they are to be matched, with the normals that the front asks for.
    undisturbed : MatchingPair
        The pair before the nuisance.
    begin : callable
        Called with the name of each stage as it begins.

    Returns
    -------
    Correspondences
        With every field that a method may need.
    """
    front = read_front(case)
    detector, descriptor = COMBINATIONS[case.combination]
    begin("resolution")
    scans = as_scan("source", clouds[0]), as_scan("target", clouds[1])
    pr = _find_unit(front, scans, undisturbed)
    front_end = FrontEnd(detector, None, case.nms_radius, _THREADS, front.harris_radius, front.iss_radii)
    described: list[DescribedCloud] = []
    for scan in scans:

        def begin_step(step: str, role: str = scan.name) -> None:
            begin(f"{role} {step}")

        found = front_end.describe(scan, pr, descriptor, "given", ORIGIN, begin_step)
        if front.frames == "toldi":
            begin_step("frames")
            found = _with_toldi_frames(found, scan)
        described.append(found)
    begin("matching")
    source, target = described
    mutual = front.matching == "mutual"
    matches = features.match(source.descriptors, target.descriptors, mutual=mutual, threads=_THREADS)
    if front.similarity == "raw":
        matches = replace(matches, similarity=1 - matches.distance)
    return as_correspondences(source, target, matches)


def _find_unit(front: FrontEntry, scans: tuple[Scan, Scan], undisturbed: MatchingPair) -> float:
    """Find the unit pr of all lengths."""
    source, target = scans
    match front.resolution:
        case "pair":
            return common_resolution(source, target, _THREADS)
        case "undisturbed":
            before = undisturbed.source.points, undisturbed.target.points
            return common_resolution(as_scan("source", before[0]), as_scan("target", before[1]), _THREADS)
        case "source":
            return source.resolution(_THREADS)
        case "target":
            return target.resolution(_THREADS)


def _with_toldi_frames(described: DescribedCloud, scan: Scan) -> DescribedCloud:
    """Give keypoints the frames of TOLDI in place of SHOT's."""
    radius = SUPPORT_RADIUS * described.resolution
    frames = features.toldi_lrf(scan.cloud, described.indices, radius=radius, threads=_THREADS)
    return replace(described, lrf=frames)
