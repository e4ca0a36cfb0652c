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

from cgroup.benchmark.packing import floats_as_bytes, pack, pack_mask, unpack
from cgroup.benchmark.results import Grouped, Matched
from cgroup.datasets import CorrespondencePair, MatchingPair, open_dataset
from cgroup.errors import NoConsensusError
from cgroup.evaluation import within
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN
from cgroup.nuisances import apply_nuisance
from cgroup.registration import correspond, surface_normals
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


def match_cases(cases: Sequence[Case], root: str | None) -> list[Matched]:
    """Load pairs, disturb them, match them.

    Parameters
    ----------
    cases : sequence of Case
        What to do; cases of the same pair after each other load it once.
    root : str, optional
        Folder with the data, as this machine sees it.

    Returns
    -------
    list of Matched
        One each, with the error where there was one.
    """
    return [_match(case, root) for case in cases]


def _match(case: Case, root: str | None) -> Matched:
    try:
        pair = _pair(case.dataset, case.pair, root)
        if isinstance(pair, CorrespondencePair):
            return _ready_made(case, pair)
        if case.nuisance:
            assert case.level is not None  # noqa: S101 - the configuration has been checked
            pair = apply_nuisance(case.nuisance, pair, case.level, case.rng("nuisance"))
            return _matched(case, pair, _clouds_with_normals(pair))
        return _matched(case, pair, _kept_clouds_with_normals(case.dataset, case.pair, root))
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this pair alone
        return Matched(case, error=_told(error))


def _matched(case: Case, pair: MatchingPair, clouds: tuple[PointCloud, PointCloud]) -> Matched:
    parameters: dict[str, Any] = {
        "detector": case.detector,
        "descriptor": case.descriptor,
        "nms_radius": case.nms_radius,
    }
    clock = _Clock()
    matches = correspond(*clouds, threads=1, normals="given", progress=clock.start, **parameters)
    parameters["normals"] = pair.normals
    parameters["source_viewpoint"] = pair.source_viewpoint
    parameters["target_viewpoint"] = pair.target_viewpoint
    clock.start("overlap")
    sample = overlap_sample(
        pair.source.points, pair.target.points, pair.T_target_source, _resolution(matches), case.rng("sample")
    )
    return Matched(
        case,
        json.dumps(parameters),
        pack(matches),
        floats_as_bytes(check_rigid(pair.T_target_source)),
        floats_as_bytes(sample),
        len(matches),
        _resolution(matches),
        json.dumps(dict(pair.facts)),
        json.dumps(clock.stop()),
    )


def _ready_made(case: Case, pair: CorrespondencePair) -> Matched:
    matches = pair.correspondences
    pr = _resolution(matches)
    sample = overlap_sample(matches.source, matches.target, pair.T_target_source, pr, case.rng("sample"))
    return Matched(
        case,
        content=pack(matches),
        truth=floats_as_bytes(check_rigid(pair.T_target_source)),
        sample=floats_as_bytes(sample),
        n=len(matches),
        pr=pr,
        facts=json.dumps(dict(pair.facts)),
    )


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
def _dataset(name: str, root: str | None) -> Dataset:
    return open_dataset(name, None if root is None else Path(root))


@functools.lru_cache(maxsize=_PAIRS_KEPT)
def _pair(dataset: str, name: str, root: str | None) -> MatchingPair | CorrespondencePair:
    return _dataset(dataset, root).load(name)


@functools.lru_cache(maxsize=_PAIRS_KEPT)
def _kept_clouds_with_normals(dataset: str, name: str, root: str | None) -> tuple[PointCloud, PointCloud]:
    """Find the normals of a pair once for all its cases."""
    pair = _pair(dataset, name, root)
    assert isinstance(pair, MatchingPair)  # noqa: S101 - ready-made correspondences have no clouds
    return _clouds_with_normals(pair)


def _clouds_with_normals(pair: MatchingPair) -> tuple[PointCloud, PointCloud]:
    return (
        _with_normals(pair.source, pair.normals, pair.source_viewpoint),
        _with_normals(pair.target, pair.normals, pair.target_viewpoint),
    )


def _with_normals(cloud: PointCloud, normals: Normals, viewpoint: Viewpoint) -> PointCloud:
    if normals == "mesh" and cloud.faces is None:
        normals = "pca"
    found = surface_normals(cloud, normals=normals, viewpoint=viewpoint, threads=1)
    return replace(cloud, normals=found)


# --- group ---------------------------------------------------------------------------------------


def group_case(case_key: str, seed: int, content: bytes, methods: Sequence[Candidate]) -> list[Grouped]:
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
    list of Grouped
        One each, with the error where there was one.
    """
    correspondences = unpack(content)
    return [_grouped(case_key, seed, correspondences, method) for method in methods]


def _grouped(case_key: str, seed: int, correspondences: Correspondences, method: Candidate) -> Grouped:
    try:
        parameters = {
            "method": method.name,
            "options": method.parameters(seed, correspondences.resolution),
        }
        start = time.perf_counter()
        grouping = method.run(correspondences, seed=seed)
        seconds = time.perf_counter() - start
        return Grouped(
            case_key,
            method.key,
            json.dumps(parameters),
            pack_mask(grouping.mask),
            seconds,
            grouping.threshold,
            _pose(grouping),
            json.dumps(grouping.diagnostics, default=float),
        )
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this pair and method alone
        return Grouped(case_key, method.key, error=_told(error))


def _pose(grouping: Grouping) -> bytes | None:
    try:
        return floats_as_bytes(grouping.transform())
    except NoConsensusError:
        return None


def _resolution(correspondences: Correspondences) -> float:
    if correspondences.resolution is None:
        message = "correspondences without a resolution; thresholds in pr need one"
        raise ValueError(message)
    return correspondences.resolution


def _told(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"


class _Clock:
    """Takes the time of named steps."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}
        self._step: str | None = None
        self._since = 0.0

    def start(self, step: str) -> None:
        self.stop()
        self._step, self._since = step, time.perf_counter()

    def stop(self) -> dict[str, float]:
        if self._step is not None:
            self._seconds[self._step] = round(time.perf_counter() - self._since, 6)
        self._step = None
        return self._seconds
