"""One pair of clouds, registered by one pipeline after the other; it runs in another process."""

from __future__ import annotations

import functools
import json
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cgroup import features
from cgroup.benchmark.pipelines import Problem
from cgroup.benchmark.records.packing import floats_as_bytes
from cgroup.benchmark.records.types import RegistrationRecord
from cgroup.benchmark.run.scoring import measure_pose, none_unless_finite
from cgroup.benchmark.run.stages import describe_error, load_pair, open_once, overlap_sample
from cgroup.datasets import MatchingPair, mirror, mix
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cgroup.benchmark.cases import PairCase
    from cgroup.benchmark.pipelines import Pipeline
    from cgroup.types import FloatArray, RealArray


class _Pair(NamedTuple):
    """A problem, and what its poses are judged by; without a truth for unrelated clouds."""

    problem: Problem
    pr: float
    overlap: float | None
    truth: FloatArray | None
    sample: RealArray


def register_pair(
    case: PairCase, threads: int, pipelines: Sequence[Pipeline], root: str | None
) -> list[RegistrationRecord]:
    """Register two clouds.

    Parameters
    ----------
    case : PairCase
        Which.
    threads : int
        For each pipeline.
    pipelines : sequence of Pipeline
        Run one after the other.
    root : str, optional
        Folder with the data; the environment says by default.

    Returns
    -------
    list of RegistrationRecord
        One each, with the error where there was one.
    """
    try:
        pair = _load(case, threads, root)
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this pair alone
        message = describe_error(error)
        return [RegistrationRecord(case, each.key, threads, error=message) for each in pipelines]
    return [_register(case, pair, pipeline) for pipeline in pipelines]


def _register(case: PairCase, pair: _Pair, pipeline: Pipeline) -> RegistrationRecord:
    problem = pair.problem
    known: dict[str, Any] = {"voxel": problem.voxel, "pr": pair.pr, "overlap": pair.overlap}
    make = functools.partial(RegistrationRecord, case, pipeline.key, problem.threads, **known)
    try:
        answer, seconds = pipeline.run(problem)
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this pair and pipeline alone
        return make(error=describe_error(error))
    pose = answer.T_target_source
    return make(
        pose=None if pose is None else floats_as_bytes(pose),
        ok=answer.ok,
        probability=none_unless_finite(answer.probability),
        seconds=json.dumps({stage: round(value, 6) for stage, value in seconds.items()}),
        **_measure(pose, pair),
    )


def _measure(pose: FloatArray | None, pair: _Pair) -> dict[str, float | None]:
    """Find the errors of a pose; none where there is no true one."""
    if pose is None or pair.truth is None:
        return {}
    errors = measure_pose(pose, pair.truth, pair.sample, pair.pr)
    names = ("rotation_error", "translation_error", "rmse")
    return {name: none_unless_finite(error) for name, error in zip(names, errors, strict=True)}


def _load(case: PairCase, threads: int, root: str | None) -> _Pair:
    pair = _load_clouds(case.dataset, case.pair, root)
    viewpoints = open_once(case.dataset, root).single_views
    if case.kind == "related":
        clouds, truth = pair, pair.T_target_source
    elif case.kind == "mirrored":
        clouds, truth = mirror(pair), None
    else:
        clouds, truth = mix(pair, _load_clouds(case.dataset, case.other, root)), None
    source, target = clouds.source.points, clouds.target.points
    voxel = case.voxel or features.choose_voxel(source, target)
    problem = Problem(
        source,
        target,
        clouds.source_viewpoint if viewpoints else None,
        clouds.target_viewpoint if viewpoints else None,
        voxel,
        threads,
        case.seed,
    )
    pr = (features.resolution(source) + features.resolution(target)) / 2
    if truth is None:
        return _Pair(problem, pr, None, None, np.empty((0, 3)))
    sample = overlap_sample(source, target, truth, pr, case.rng("sample"))
    return _Pair(problem, pr, pair.facts.get("overlap"), truth, sample)


def _load_clouds(dataset: str, name: str, root: str | None) -> MatchingPair:
    pair = load_pair(dataset, name, root)
    if not isinstance(pair, MatchingPair):
        message = f"{dataset}: {name} comes as correspondences; registering needs clouds"
        raise InputError(message)
    return pair
