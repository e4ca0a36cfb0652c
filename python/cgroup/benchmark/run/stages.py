"""The two stages that workers run: correspond and group.

They run in other processes, perhaps on another machine, so they take what they need as arguments, write
nothing, and turn what goes wrong with one pair into a record of its own.
"""

from __future__ import annotations

import functools
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cgroup._runtime.progress import StageClock
from cgroup.benchmark.records.packing import floats_as_bytes, pack, pack_mask, unpack
from cgroup.benchmark.records.types import GroupingRecord, MatchingRecord
from cgroup.benchmark.run.front import match_by_front, read_front
from cgroup.datasets import CorrespondencePair, MatchingPair, open_dataset
from cgroup.errors import NoConsensusError
from cgroup.evaluation import within
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN
from cgroup.nuisances import apply_nuisance
from cgroup.registration import correspond, surface_normals
from cgroup.registration.scan import usable_normals
from cgroup.rigid import apply, check_rigid

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.cases import Case
    from cgroup.datasets import Dataset
    from cgroup.registration import Normals, Viewpoint
    from cgroup.types import Correspondences, FloatArray, Grouping, PointCloud, RealArray

KILLED = "WorkerKilled: the process that worked on it died, perhaps for want of memory"
"""Error of a task that took its worker with it."""

OVERLAP_SAMPLE = 1000
"""Source points in the overlap on which the error of an estimated pose is measured, at most."""

_CANDIDATES_PER_SAMPLE = 5  # source points that are tried, per point of the sample
_PAIRS_KEPT = 2  # loaded pairs that a worker keeps: its next task is often about one of them


# --- correspond ----------------------------------------------------------------------------------


def match_cases(cases: Sequence[Case], root: str | None) -> list[MatchingRecord]:
    """Load pairs, disturb them, match them.

    Parameters
    ----------
    cases : sequence of Case
        What to do; cases of the same pair after each other load it once.
    root : str, optional
        Folder with the data, as this machine sees it.

    Returns
    -------
    list of MatchingRecord
        One each, with the error where there was one.
    """
    return [_match(case, root) for case in cases]


def _match(case: Case, root: str | None) -> MatchingRecord:
    try:
        pair = load_pair(case.dataset, case.pair, root)
        if isinstance(pair, CorrespondencePair):
            return _record_ready_made(case, pair)
        normals = read_front(case).normals or pair.normals
        if not case.nuisance:
            clouds = _load_with_normals(case.dataset, case.pair, normals, root)
            return _match_clouds(case, pair, clouds, normals, pair)
        assert case.level is not None  # noqa: S101 - the configuration has been checked
        disturbed = apply_nuisance(case.nuisance, pair, case.level, case.rng("nuisance"))
        return _match_clouds(case, disturbed, _add_normals(disturbed, normals), normals, pair)
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this pair alone
        return MatchingRecord(case, error=describe_error(error))


def _match_clouds(
    case: Case,
    pair: MatchingPair,
    clouds: tuple[PointCloud, PointCloud],
    normals: Normals,
    undisturbed: MatchingPair,
) -> MatchingRecord:
    """Match the clouds of a pair, which bring their normals."""
    front: dict[str, Any] = {
        "detector": case.detector,
        "descriptor": case.descriptor,
        "nms_radius": case.nms_radius,
    }
    surface = {
        "normals": normals,
        "source_viewpoint": pair.source_viewpoint,
        "target_viewpoint": pair.target_viewpoint,
    }
    changes = {"front": json.loads(case.front)} if case.front else {}
    clock = StageClock()
    if case.front:
        matches = match_by_front(case, clouds, undisturbed, clock.start)
    else:
        matches = correspond(*clouds, threads=1, normals="given", progress=clock.start, **front)
    clock.start("overlap")
    truth, pr = pair.T_target_source, _resolution(matches)
    sample = overlap_sample(pair.source.points, pair.target.points, truth, pr, case.rng("sample"))
    clock.stop()
    return MatchingRecord(
        case,
        json.dumps(front | surface | changes),
        seconds=json.dumps({stage: round(seconds, 6) for stage, seconds in clock.seconds.items()}),
        **_describe_problem(matches, pair, sample),
    )


def _record_ready_made(case: Case, pair: CorrespondencePair) -> MatchingRecord:
    matches = pair.correspondences
    truth, pr = pair.T_target_source, _resolution(matches)
    sample = overlap_sample(matches.source, matches.target, truth, pr, case.rng("sample"))
    return MatchingRecord(case, **_describe_problem(matches, pair, sample))


def _describe_problem(
    matches: Correspondences, pair: MatchingPair | CorrespondencePair, sample: RealArray
) -> dict[str, Any]:
    """Fields of `MatchingRecord` that are the same wherever the matches come from."""
    return {
        "content": pack(matches),
        "truth": floats_as_bytes(check_rigid(pair.T_target_source)),
        "sample": floats_as_bytes(sample),
        "n": len(matches),
        "pr": _resolution(matches),
        "facts": json.dumps(dict(pair.facts)),
    }


def overlap_sample(
    source: RealArray, target: RealArray, truth: FloatArray, pr: float, rng: np.random.Generator
) -> RealArray:
    """Source points that lie close to the target under the true pose.

    Parameters
    ----------
    source, target : (N,3) and (M,3) array of float
        Whole clouds.
    truth : (4,4) array of float64
        True pose.
    pr : float
        Resolution; close is within `OVERLAP_WITHIN` of it.
    rng : Generator
        Draws the points that are tried.

    Returns
    -------
    (m,3) array of float
        At most `OVERLAP_SAMPLE`.
    """
    tried = source[rng.permutation(len(source))[: _CANDIDATES_PER_SAMPLE * OVERLAP_SAMPLE]]
    close = within(apply(truth, tried), target, OVERLAP_WITHIN * pr)
    return tried[close][:OVERLAP_SAMPLE]


@functools.lru_cache(maxsize=8)
def open_once(name: str, root: str | None) -> Dataset:
    """Open a data set, the first time it is asked for."""
    return open_dataset(name, None if root is None else Path(root))


@functools.lru_cache(maxsize=_PAIRS_KEPT)
def load_pair(dataset: str, name: str, root: str | None) -> MatchingPair | CorrespondencePair:
    """Load a pair, unless it is one of the last."""
    return open_once(dataset, root).load(name)


@functools.lru_cache(maxsize=2 * _PAIRS_KEPT)  # cases of a pair may differ in their normals
def _load_with_normals(
    dataset: str, name: str, normals: Normals, root: str | None
) -> tuple[PointCloud, PointCloud]:
    """Find the normals of a pair once for all its cases."""
    pair = load_pair(dataset, name, root)
    assert isinstance(pair, MatchingPair)  # noqa: S101 - ready-made correspondences have no clouds
    return _add_normals(pair, normals)


def forget_pairs() -> None:
    """Let go of what was loaded: it may have changed since."""
    for kept in (open_once, load_pair, _load_with_normals):
        kept.cache_clear()


def _add_normals(pair: MatchingPair, normals: Normals) -> tuple[PointCloud, PointCloud]:
    return (
        _with_normals(pair.source, normals, pair.source_viewpoint),
        _with_normals(pair.target, normals, pair.target_viewpoint),
    )


def _with_normals(cloud: PointCloud, normals: Normals, viewpoint: Viewpoint) -> PointCloud:
    usable = usable_normals(normals, cloud)
    found = surface_normals(cloud, normals=usable, viewpoint=viewpoint, threads=1)
    return replace(cloud, normals=found)


# --- group ---------------------------------------------------------------------------------------


def group_case(
    case_key: str, seed: int, content: bytes, methods: Sequence[Candidate]
) -> list[GroupingRecord]:
    """Run methods on the correspondences of one case, on one thread.

    Parameters
    ----------
    case_key : str
        Which case.
    seed : int
        For methods that draw random numbers.
    content : bytes
        The correspondences, see `pack`.
    methods : sequence of Candidate
        What to run.

    Returns
    -------
    list of GroupingRecord
        One each, with the error where there was one.
    """
    try:
        correspondences = unpack(content)
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this case alone
        message = describe_error(error)
        return [GroupingRecord(case_key, method.key, error=message) for method in methods]
    return [_group(case_key, seed, correspondences, method) for method in methods]


def _group(case_key: str, seed: int, correspondences: Correspondences, method: Candidate) -> GroupingRecord:
    try:
        parameters = {
            "method": method.name,
            "options": method.parameters(seed, correspondences.resolution),
        }
        start = time.perf_counter()
        grouping = method.run(correspondences, seed=seed)
        seconds = time.perf_counter() - start
        return GroupingRecord(
            case_key,
            method.key,
            json.dumps(parameters),
            pack_mask(grouping.mask),
            seconds,
            grouping.threshold,
            _find_pose(grouping),
            json.dumps(grouping.diagnostics, default=float),
        )
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this pair and method alone
        return GroupingRecord(case_key, method.key, error=describe_error(error))


def _find_pose(grouping: Grouping) -> bytes | None:
    try:
        return floats_as_bytes(grouping.transform())
    except NoConsensusError:
        return None


def _resolution(correspondences: Correspondences) -> float:
    if correspondences.resolution is None:
        message = "correspondences without a resolution; thresholds in pr need one"
        raise ValueError(message)
    return correspondences.resolution


def describe_error(error: Exception) -> str:
    """Type and message in one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
