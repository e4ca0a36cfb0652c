"""Matches to be grouped, made from the clouds of a pair, and what the answers are judged by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgroup import features
from cgroup.benchmark.cases import COMBINATIONS
from cgroup.benchmark.run.stages import describe_error, load_pair, overlap_sample
from cgroup.datasets import CorrespondencePair, mirror, mix
from cgroup.errors import InputError
from cgroup.evaluation import match_errors
from cgroup.registration import DescribedCloud, correspond
from cgroup.registration.matching import match_both_ways, take_matches
from cgroup.registration.scan import usable_normals

if TYPE_CHECKING:
    from cgroup.benchmark.cases import Problem
    from cgroup.datasets import MatchingPair, UnrelatedPair
    from cgroup.features import Viewpoint
    from cgroup.types import BoolArray, Correspondences, FloatArray, PointCloud, RealArray

MATCH_RESOLUTION = 0.4
"""Unit of dense matches, in voxels."""

NORMAL_RADIUS, NORMAL_NEIGHBORS = 2.0, 30
"""Radius in voxels and most points of a plane that is fitted."""

FPFH_RADIUS, FRAME_RADIUS = 5.0, 8.0
"""Radii in voxels of the support of a descriptor, and of a frame."""


@dataclass(frozen=True, eq=False)
class PreparedProblem:
    """Matches, and the truth about them.

    Attributes
    ----------
    matches : Correspondences
        With every field that there is.
    correct : (n,) array of bool
        Whether each is within epsilon of its true place.
    truth : (4,4) array of float64 or None
        True pose; None where there is none.
    sample : (m,3) array of float
        Source points in the overlap.
    resolution, pr : float
        Unit of the matches, and mean distance of neighbours in the clouds, in the data's unit.
    overlap : float or None
        Share that the clouds have in common, where it is known.
    """

    matches: Correspondences
    correct: BoolArray
    truth: FloatArray | None
    sample: RealArray
    resolution: float
    pr: float
    overlap: float | None = None


def try_to_prepare(case: Problem, root: str | None) -> PreparedProblem | str:
    """Call `prepare_problem`; return the error where there is one."""
    try:
        return prepare_problem(case, root)
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this problem alone
        return describe_error(error)


def prepare_problem(case: Problem, root: str | None) -> PreparedProblem:
    """Load a pair, and match its clouds unless it comes as matches.

    Parameters
    ----------
    case : Problem
        Which.
    root : str, optional
        Folder with the data; the environment says by default.

    Returns
    -------
    PreparedProblem

    Raises
    ------
    InputError
        If the matches have no resolution, or the other pair has no clouds.
    """
    pair = load_pair(case.dataset, case.pair, root)
    related = case.kind == "related"
    if isinstance(pair, CorrespondencePair):
        matches = pair.correspondences
        clouds, pr = (matches.source, matches.target), _resolution(matches)
    else:
        both = pair if related else _unrelated(case, pair, root)
        clouds = both.source.points, both.target.points
        pr = (features.resolution(clouds[0]) + features.resolution(clouds[1])) / 2
        matches = _match_clouds(case, pair, both)
    resolution = _resolution(matches)
    if not related:
        nothing = np.zeros(len(matches), dtype=bool)
        return PreparedProblem(matches, nothing, None, np.empty((0, 3)), resolution, pr)
    truth = pair.T_target_source
    correct = match_errors(matches.source, matches.target, truth) <= case.epsilon * resolution
    sample = overlap_sample(*clouds, truth, pr, case.rng("sample"))
    return PreparedProblem(matches, correct, truth, sample, resolution, pr, pair.facts.get("overlap"))


def _unrelated(case: Problem, pair: MatchingPair, root: str | None) -> UnrelatedPair:
    if case.kind == "mirrored":
        return mirror(pair)
    other = load_pair(case.dataset, case.other, root)
    if isinstance(other, CorrespondencePair):
        message = f"{case.dataset}: {case.other} comes as correspondences; only clouds can be mixed"
        raise InputError(message)
    return mix(pair, other)


def _match_clouds(case: Problem, pair: MatchingPair, clouds: MatchingPair | UnrelatedPair) -> Correspondences:
    if case.matches not in COMBINATIONS:
        return _match_voxels(case, clouds)
    detector, descriptor = COMBINATIONS[case.matches]
    return correspond(
        clouds.source,
        clouds.target,
        detector=detector,
        descriptor=descriptor,
        # Mixed and mirrored clouds may have lost their faces or normals.
        normals=usable_normals(pair.normals, clouds.source, clouds.target),
        source_viewpoint=clouds.source_viewpoint,
        target_viewpoint=clouds.target_viewpoint,
    )


def _match_voxels(case: Problem, clouds: MatchingPair | UnrelatedPair) -> Correspondences:
    voxel = case.voxel or features.choose_voxel(clouds.source.points, clouds.target.points)
    unit_length = case.matches == "nearest, unit length"
    source = _describe(clouds.source, clouds.source_viewpoint, voxel, unit_length=unit_length)
    target = _describe(clouds.target, clouds.target_viewpoint, voxel, unit_length=unit_length)
    nearest = 3 if case.matches == "three nearest" else 1
    matches, mutual = match_both_ways(source, target, nearest, None)
    return take_matches(matches, mutual) if case.matches == "mutual" else matches


def _describe(cloud: PointCloud, viewpoint: Viewpoint, voxel: float, *, unit_length: bool) -> DescribedCloud:
    """Describe every voxel of a cloud by FPFH; normals are on the side of the cloud's own, if it has some."""
    voxels = features.voxel_downsample(cloud.points, voxel, normals=cloud.normals)
    thinned = features.Cloud(voxels.points)
    normals = features.normals(
        thinned, radius=NORMAL_RADIUS * voxel, neighbors=NORMAL_NEIGHBORS, viewpoint=viewpoint
    )
    if voxels.normals is not None:
        normals *= np.where(np.einsum("ij,ij->i", normals, voxels.normals) < 0, -1.0, 1.0)[:, None]
    values = features.fpfh(thinned, normals, radius=FPFH_RADIUS * voxel)
    frames = features.shot_lrf(thinned, np.arange(len(voxels)), radius=FRAME_RADIUS * voxel)
    rows = np.flatnonzero(np.isfinite(values).all(axis=1) & values.any(axis=1))
    chosen = values[rows]
    if unit_length:
        chosen = chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
    center = cloud.points.mean(axis=0)
    return DescribedCloud(rows, voxels.points[rows], frames[rows], chosen, MATCH_RESOLUTION * voxel, center)


def _resolution(matches: Correspondences) -> float:
    if matches.resolution is None:
        message = "correspondences without a resolution; thresholds in pr need one"
        raise InputError(message)
    return matches.resolution
