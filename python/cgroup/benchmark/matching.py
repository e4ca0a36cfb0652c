"""Matching of a problem's clouds: by the paper's front end, with an experiment's changes, or by voxels."""

import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cgroup import features
from cgroup.benchmark.entries import FrontEntry
from cgroup.benchmark.pipelines.own import describe_voxels
from cgroup.benchmark.problem import (
    COMBINATIONS,
    LoadedProblem,
    Problem,
    known_resolution,
    load_pair,
    open_once,
)
from cgroup.benchmark.results import Matched, describe_error
from cgroup.datasets import MatchingPair, UnrelatedPair
from cgroup.features import Viewpoint
from cgroup.fronts.matching import match_both_ways, take_matches
from cgroup.fronts.paper_front import common_resolution, correspond_by
from cgroup.fronts.scan import as_scan, usable_normals
from cgroup.nuisances import apply_nuisance
from cgroup.registration import DenseFront, DescribedCloud, Normals, PaperFront, correspond, surface_normals
from cgroup.registration.prepare import UNIT
from cgroup.rigid import check_rigid
from cgroup.types import Correspondences, PointCloud

_THREADS = 1  # workers compute on one


def forget_pairs() -> None:
    """Clear the caches of loaded data, which may have changed."""
    for kept in (open_once, load_pair, _load_with_normals):
        kept.cache_clear()


def match_problems(problems: Sequence[Problem], root: str | None) -> list[Matched | str]:
    """Match problems; return an error for each failed one. Consecutive problems of a pair load it once."""
    return [match_problem(problem, root) for problem in problems]


def match_problem(problem: Problem, root: str | None) -> Matched | str:
    """Load, disturb and match a pair, unless it has matches; return the error if there is one."""
    try:
        return _match(problem, problem.load(root), root)
    except Exception as error:  # noqa: BLE001 - errors of any kind concern this problem only
        return describe_error(error)


def _match(problem: Problem, loaded: LoadedProblem, root: str | None) -> Matched:
    if not isinstance(loaded.pair, MatchingPair):
        matches = loaded.pair.correspondences
    elif problem.task == "timing":
        matches = _correspond(loaded.pair, loaded.pair.normals, keypoints=problem.size)
    elif problem.task == "experiment":
        loaded, matches = _match_disturbed(problem, loaded.pair, loaded, root)
    else:
        matches = _match_clouds(problem, loaded)
    resolution = known_resolution(matches.resolution)
    pr = loaded.measure_pr() if problem.task == "matches" else resolution
    sample = loaded.draw_sample(pr, problem.rng("sample"))
    truth = None if loaded.truth is None else check_rigid(loaded.truth)
    return Matched(matches, truth, sample, pr, loaded.facts)


def _match_disturbed(
    problem: Problem, pair: MatchingPair, loaded: LoadedProblem, root: str | None
) -> tuple[LoadedProblem, Correspondences]:
    """Disturb a pair and match its clouds; return also the disturbed pair."""
    normals = read_front(problem).normals or pair.normals
    if problem.nuisance:
        assert problem.level is not None  # noqa: S101 - the configuration has been checked
        disturbed = apply_nuisance(problem.nuisance, pair, problem.level, problem.rng("nuisance"))
        clouds = add_normals(disturbed, normals)
        loaded = replace(loaded, pair=disturbed, clouds=disturbed, truth=disturbed.T_target_source)
    else:
        clouds = _load_with_normals(problem.dataset, problem.pair, normals, root)
    return loaded, match_by_front(problem, clouds, pair)


def _correspond(
    clouds: MatchingPair | UnrelatedPair,
    normals: Normals,
    **options: Any,  # noqa: ANN401 - of `correspond`
) -> Correspondences:
    return correspond(
        clouds.source,
        clouds.target,
        normals=normals,
        source_viewpoint=clouds.source_viewpoint,
        target_viewpoint=clouds.target_viewpoint,
        **options,
    )


@functools.lru_cache(maxsize=4)  # problems of a pair may differ in their normals
def _load_with_normals(
    dataset: str, name: str, normals: Normals, root: str | None
) -> tuple[PointCloud, PointCloud]:
    """Return the clouds of a pair with normals, computed once for all its problems."""
    pair = load_pair(dataset, name, root)
    assert isinstance(pair, MatchingPair)  # noqa: S101 - ready-made correspondences have no clouds
    return add_normals(pair, normals)


def add_normals(pair: MatchingPair, normals: Normals) -> tuple[PointCloud, PointCloud]:
    """Return both clouds of a pair with normals."""

    def add(cloud: PointCloud, viewpoint: Viewpoint) -> PointCloud:
        usable = usable_normals(normals, cloud)
        found = surface_normals(cloud, normals=usable, viewpoint=viewpoint, threads=_THREADS)
        return replace(cloud, normals=found)

    return add(pair.source, pair.source_viewpoint), add(pair.target, pair.target_viewpoint)


def read_front(problem: Problem) -> FrontEntry:
    """Return the front-end changes of a problem."""
    return FrontEntry.model_validate_json(problem.front or "{}")


def match_by_front(
    problem: Problem, clouds: tuple[PointCloud, PointCloud], undisturbed: MatchingPair
) -> Correspondences:
    """Match two clouds with normals by a changed paper front end, given the pair before the nuisance."""
    entry = read_front(problem)
    changed = entry.model_dump(exclude={"normals", "resolution"})
    resolution = _find_unit(entry.resolution, clouds, undisturbed)
    detection = {"nms_radius": problem.nms_radius, "resolution": resolution}
    front = PaperFront(*COMBINATIONS[problem.matches], normals="given", **detection, **changed)
    return correspond_by(front, *clouds, threads=_THREADS)


def _find_unit(of: str, clouds: tuple[PointCloud, PointCloud], undisturbed: MatchingPair) -> float | None:
    """Return the unit pr of all lengths; None for the mean of both clouds."""
    if of == "pair":
        return None
    if of == "undisturbed":
        source, target = undisturbed.source.points, undisturbed.target.points
        return common_resolution(as_scan("source", source), as_scan("target", target), _THREADS)
    return as_scan(of, clouds[0 if of == "source" else 1]).resolution(_THREADS)


def _match_clouds(problem: Problem, loaded: LoadedProblem) -> Correspondences:
    clouds = loaded.clouds
    assert clouds is not None  # noqa: S101 - only pairs of matches have none
    assert isinstance(loaded.pair, MatchingPair)  # noqa: S101
    if problem.matches in COMBINATIONS:
        # Mixed and mirrored clouds may lack faces or normals.
        normals = usable_normals(loaded.pair.normals, clouds.source, clouds.target)
        return _correspond(clouds, normals, detector=problem.detector, descriptor=problem.descriptor)
    voxel = problem.voxel or features.choose_voxel(clouds.source.points, clouds.target.points)
    unit_length = problem.matches == "nearest, unit length"
    source = _describe(clouds.source, clouds.source_viewpoint, voxel, unit_length=unit_length)
    target = _describe(clouds.target, clouds.target_viewpoint, voxel, unit_length=unit_length)
    nearest = 3 if problem.matches == "three nearest" else 1
    matches, mutual = match_both_ways(source, target, nearest, None)
    return take_matches(matches, mutual) if problem.matches == "mutual" else matches


def _describe(cloud: PointCloud, viewpoint: Viewpoint, voxel: float, *, unit_length: bool) -> DescribedCloud:
    """Describe every voxel of a cloud; normals point to the side of the cloud's own normals, if any."""
    downsampled, points, values = describe_voxels(cloud.points, viewpoint, voxel, normals=cloud.normals)
    radius = DenseFront.frame_radius * voxel
    frames = features.shot_lrf(downsampled, np.arange(len(points)), radius=radius)
    rows = np.flatnonzero(np.isfinite(values).all(axis=1) & values.any(axis=1))
    chosen = values[rows]
    if unit_length:
        chosen = chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
    center = cloud.points.mean(axis=0)
    return DescribedCloud(rows, points[rows], frames[rows], chosen, UNIT * voxel, center)
