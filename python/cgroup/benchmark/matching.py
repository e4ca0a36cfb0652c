"""Clouds of a problem become matches: by the paper's front end, one that an experiment changes, or voxels."""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup import features
from cgroup._runtime.progress import StageClock
from cgroup.benchmark.config import FrontEntry
from cgroup.benchmark.pipelines.own import describe_voxels
from cgroup.benchmark.problem import COMBINATIONS, known_resolution, load_pair, open_once
from cgroup.benchmark.results import Matched, describe_error, floats_as_bytes, pack, rounded_json
from cgroup.datasets import MatchingPair
from cgroup.evaluation import match_errors
from cgroup.nuisances import apply_nuisance
from cgroup.registration import DenseFront, DescribedCloud, PaperFront, correspond, surface_normals
from cgroup.registration.matching import match_both_ways, take_matches
from cgroup.registration.paper_front import common_resolution, correspond_by
from cgroup.registration.prepare import UNIT
from cgroup.registration.scan import as_scan, usable_normals
from cgroup.rigid import check_rigid

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from cgroup.benchmark.problem import LoadedProblem, Problem
    from cgroup.datasets import UnrelatedPair
    from cgroup.features import Viewpoint
    from cgroup.registration import Normals
    from cgroup.types import BoolArray, Correspondences, FloatArray, PointCloud, RealArray

_THREADS = 1  # workers compute on one


# --- experiments -----------------------------------------------------------------------------------


def match_problems(problems: Sequence[Problem], root: str | None) -> list[Matched]:
    """Load pairs of an experiment, disturb them and match them; an error becomes part of the record.

    Problems of the same pair after each other load it once.
    """
    return [_try_to_match(problem, root) for problem in problems]


def forget_pairs() -> None:
    """Let go of what was loaded: it may have changed since."""
    for kept in (open_once, load_pair, _load_with_normals):
        kept.cache_clear()


def _try_to_match(problem: Problem, root: str | None) -> Matched:
    try:
        loaded = problem.load(root)
        if isinstance(loaded.pair, MatchingPair) and problem.task != "timing":
            return _match_pair(problem, loaded, loaded.pair, root)
        if isinstance(loaded.pair, MatchingPair):
            matches = _correspond(loaded.pair, loaded.pair.normals, keypoints=problem.size)
        else:
            matches = loaded.pair.correspondences
        return _record(problem, loaded, matches, StageClock(), "{}")
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this pair alone
        return Matched(problem.key, error=describe_error(error))


def _match_pair(problem: Problem, loaded: LoadedProblem, pair: MatchingPair, root: str | None) -> Matched:
    """Disturb a pair and match its clouds, which bring their normals."""
    normals = read_front(problem).normals or pair.normals
    disturbed = pair
    if problem.nuisance:
        assert problem.level is not None  # noqa: S101 - the configuration has been checked
        disturbed = apply_nuisance(problem.nuisance, pair, problem.level, problem.rng("nuisance"))
        clouds = add_normals(disturbed, normals)
        loaded = replace(loaded, pair=disturbed, clouds=disturbed, truth=disturbed.T_target_source)
    else:
        clouds = _load_with_normals(problem.dataset, problem.pair, normals, root)
    parameters: dict[str, Any] = {
        "detector": problem.detector,
        "descriptor": problem.descriptor,
        "nms_radius": problem.nms_radius,
        "normals": normals,
        "source_viewpoint": disturbed.source_viewpoint,
        "target_viewpoint": disturbed.target_viewpoint,
    }
    if problem.front:
        parameters["front"] = json.loads(problem.front)
    clock = StageClock()
    matches = match_by_front(problem, clouds, pair, clock.start)
    return _record(problem, loaded, matches, clock, json.dumps(parameters))


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


def _record(
    problem: Problem, loaded: LoadedProblem, matches: Correspondences, clock: StageClock, parameters: str
) -> Matched:
    clock.start("overlap")
    pr = known_resolution(matches.resolution)
    sample = loaded.draw_sample(pr, problem.rng("sample"))
    seconds = clock.stop()
    assert loaded.truth is not None  # noqa: S101 - pairs of experiments are related
    return Matched(
        problem.key,
        pack(matches),
        floats_as_bytes(check_rigid(loaded.truth)),
        floats_as_bytes(sample),
        len(matches),
        pr,
        json.dumps(dict(loaded.pair.facts)),
        rounded_json(seconds),
        parameters,
    )


@functools.lru_cache(maxsize=4)  # problems of a pair may differ in their normals
def _load_with_normals(
    dataset: str, name: str, normals: Normals, root: str | None
) -> tuple[PointCloud, PointCloud]:
    """Find the normals of a pair once for all its problems."""
    pair = load_pair(dataset, name, root)
    assert isinstance(pair, MatchingPair)  # noqa: S101 - ready-made correspondences have no clouds
    return add_normals(pair, normals)


def add_normals(pair: MatchingPair, normals: Normals) -> tuple[PointCloud, PointCloud]:
    """Give both clouds of a pair their normals."""

    def add(cloud: PointCloud, viewpoint: Viewpoint) -> PointCloud:
        usable = usable_normals(normals, cloud)
        found = surface_normals(cloud, normals=usable, viewpoint=viewpoint, threads=_THREADS)
        return replace(cloud, normals=found)

    return add(pair.source, pair.source_viewpoint), add(pair.target, pair.target_viewpoint)


# --- a front end that an experiment changes --------------------------------------------------------


def read_front(problem: Problem) -> FrontEntry:
    """Read what a problem changes of the front end."""
    return FrontEntry.model_validate_json(problem.front or "{}")


def match_by_front(
    problem: Problem,
    clouds: tuple[PointCloud, PointCloud],
    undisturbed: MatchingPair,
    begin: Callable[[str], Any],
) -> Correspondences:
    """Match two clouds, with the normals that the front asks for, by the steps of `correspond`, changed.

    `undisturbed` is the pair before the nuisance; `begin` is called with the name of each stage.
    """
    entry = read_front(problem)
    changed = entry.model_dump(exclude={"normals", "resolution"})
    resolution = _find_unit(entry.resolution, clouds, undisturbed)
    detection = {"nms_radius": problem.nms_radius, "resolution": resolution}
    front = PaperFront(*COMBINATIONS[problem.matches], normals="given", **detection, **changed)
    return correspond_by(front, *clouds, threads=_THREADS, begin=begin)


def _find_unit(of: str, clouds: tuple[PointCloud, PointCloud], undisturbed: MatchingPair) -> float | None:
    """Find the unit pr of all lengths; None for the mean of both clouds."""
    if of == "pair":
        return None
    if of == "undisturbed":
        source, target = undisturbed.source.points, undisturbed.target.points
        return common_resolution(as_scan("source", source), as_scan("target", target), _THREADS)
    return as_scan(of, clouds[0 if of == "source" else 1]).resolution(_THREADS)


# --- matches of any kind ---------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class PreparedMatches:
    """Matches, and the truth about them: which are correct, the true pose if there is one.

    `sample` are source points in the overlap, `resolution` is the unit of the matches, `pr` the mean distance
    of neighbours in the clouds, both in the data's unit; `overlap` is the share that both clouds have.
    """

    matches: Correspondences
    correct: BoolArray
    truth: FloatArray | None
    sample: RealArray
    resolution: float
    pr: float
    overlap: float | None = None


def try_to_prepare(problem: Problem, root: str | None) -> PreparedMatches | str:
    """Load a pair, and match its clouds unless it comes as matches; return the error where there is one."""
    try:
        return _prepare(problem, problem.load(root))
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this problem alone
        return describe_error(error)


def _prepare(problem: Problem, loaded: LoadedProblem) -> PreparedMatches:
    pr, truth = loaded.measure_pr(), loaded.truth
    if isinstance(loaded.pair, MatchingPair):
        assert loaded.clouds is not None  # noqa: S101 - such pairs have clouds
        matches = _match_clouds(problem, loaded.pair, loaded.clouds)
    else:
        matches = loaded.pair.correspondences
    resolution = known_resolution(matches.resolution)
    correct = np.zeros(len(matches), dtype=bool)
    if truth is not None:
        correct = match_errors(matches.source, matches.target, truth) <= problem.epsilon * resolution
    sample = loaded.draw_sample(pr, problem.rng("sample"))
    return PreparedMatches(matches, correct, truth, sample, resolution, pr, loaded.overlap)


def _match_clouds(
    problem: Problem, pair: MatchingPair, clouds: MatchingPair | UnrelatedPair
) -> Correspondences:
    if problem.matches in COMBINATIONS:
        # Mixed and mirrored clouds may have lost their faces or normals.
        normals = usable_normals(pair.normals, clouds.source, clouds.target)
        return _correspond(clouds, normals, detector=problem.detector, descriptor=problem.descriptor)
    voxel = problem.voxel or features.choose_voxel(clouds.source.points, clouds.target.points)
    unit_length = problem.matches == "nearest, unit length"
    source = _describe(clouds.source, clouds.source_viewpoint, voxel, unit_length=unit_length)
    target = _describe(clouds.target, clouds.target_viewpoint, voxel, unit_length=unit_length)
    nearest = 3 if problem.matches == "three nearest" else 1
    matches, mutual = match_both_ways(source, target, nearest, None)
    return take_matches(matches, mutual) if problem.matches == "mutual" else matches


def _describe(cloud: PointCloud, viewpoint: Viewpoint, voxel: float, *, unit_length: bool) -> DescribedCloud:
    """Describe every voxel of a cloud; normals are on the side of the cloud's own, if it has some."""
    thinned, points, values = describe_voxels(cloud.points, viewpoint, voxel, normals=cloud.normals)
    radius = DenseFront.frame_radius * voxel
    frames = features.shot_lrf(thinned, np.arange(len(points)), radius=radius)
    rows = np.flatnonzero(np.isfinite(values).all(axis=1) & values.any(axis=1))
    chosen = values[rows]
    if unit_length:
        chosen = chosen / np.linalg.norm(chosen, axis=1, keepdims=True)
    center = cloud.points.mean(axis=0)
    return DescribedCloud(rows, points[rows], frames[rows], chosen, UNIT * voxel, center)
