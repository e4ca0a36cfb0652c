"""The three stages, as functions from arguments to records: correspond, group, score.

They run in worker processes, perhaps on another machine, so they take what they need as arguments, write
nothing, and turn what goes wrong with one pair into a record of its own.
"""

from __future__ import annotations

import functools
import io
import json
import time
import zipfile
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup import __version__
from cgroup.benchmark.machine import Machine, this_machine
from cgroup.datasets import CorrespondencePair, open_dataset
from cgroup.errors import NoConsensusError
from cgroup.evaluation import match_errors, rotation_error, score_group, translation_error, within
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN
from cgroup.evaluation.protocols import PROTOCOLS
from cgroup.io import check_rigid
from cgroup.nuisances import apply_nuisance
from cgroup.registration import correspond
from cgroup.types import OPTIONAL_FIELDS, Correspondences, FloatArray

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.cases import Case
    from cgroup.datasets import Dataset, MatchingPair
    from cgroup.types import BoolArray, Grouping

KILLED = "WorkerKilled: the process that worked on it died, perhaps for want of memory"
"""Error of a task that took its worker with it."""

OVERLAP_SAMPLE = 1000
"""Source points in the overlap on which the error of an estimated pose is measured, at most."""

_CANDIDATES_PER_SAMPLE = 5  # source points that are tried, per point of the sample
_PAIRS_KEPT = 2  # loaded pairs that a worker keeps: its next task is often about one of them


def _now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")


@dataclass(frozen=True)
class Provenance:
    """Where and when a record was made."""

    version: str = __version__
    machine: Machine = field(default_factory=this_machine)
    created: str = field(default_factory=_now)


@dataclass(frozen=True)
class Matched:
    """Record of the first stage.

    Attributes
    ----------
    case : Case
        What was asked for.
    parameters : str
        JSON of what `correspond` was given.
    content : bytes
        The `Correspondences`, see `pack`; empty after an error.
    truth : bytes
        True pose, 16 float64.
    sample : bytes
        Source points in the overlap, float64.
    n : int
        Number of correspondences.
    pr : float
        Resolution, in the data's unit.
    facts, seconds : str
        JSON: facts about the pair; wall time of each step.
    error : str
        Type and message; empty where all went well.
    """

    case: Case
    parameters: str = "{}"
    content: bytes = b""
    truth: bytes = b""
    sample: bytes = b""
    n: int = 0
    pr: float = float("nan")
    facts: str = "{}"
    seconds: str = "{}"
    error: str = ""
    provenance: Provenance = field(default_factory=Provenance)


@dataclass(frozen=True)
class Grouped:
    """Record of the second stage.

    Attributes
    ----------
    case_key, method_key : str
        Which case and method.
    parameters : str
        JSON of what the method was given.
    mask : bytes
        The group, one bit per correspondence.
    seconds : float
        Wall time of the grouping alone.
    threshold : float, optional
        The method's cut.
    pose : bytes, optional
        Least-squares pose of the group, 16 float64; None where the group fixes none.
    diagnostics : str
        JSON of the method's own facts.
    error : str
        Type and message; empty where all went well.
    """

    case_key: str
    method_key: str
    parameters: str = "{}"
    mask: bytes = b""
    seconds: float = float("nan")
    threshold: float | None = None
    pose: bytes | None = None
    diagnostics: str = "{}"
    error: str = ""
    provenance: Provenance = field(default_factory=Provenance)


@dataclass(frozen=True)
class Scored:
    """Record of the third stage: one grouping judged at one threshold.

    Attributes
    ----------
    case_key, method_key, epsilon
        Which grouping, and the threshold in pr.
    correct, selected, selected_correct : int
        Counts.
    rotation_error, translation_error, rmse : float, optional
        Degrees, the data's unit, pr; None without a pose (or without an overlap).
    protocols : str
        JSON: whether the pair is registered by each criterion; null where it isn't applicable.
    """

    case_key: str
    method_key: str
    epsilon: float
    correct: int
    selected: int
    selected_correct: int
    rotation_error: float | None
    translation_error: float | None
    rmse: float | None
    protocols: str


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
        return _matched(case, pair)
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this pair alone
        return Matched(case, error=_told(error))


def _matched(case: Case, pair: MatchingPair) -> Matched:
    parameters: dict[str, Any] = {
        "detector": case.detector,
        "descriptor": case.descriptor,
        "nms_radius": case.nms_radius,
        "normals": pair.normals,
        "source_viewpoint": pair.source_viewpoint,
        "target_viewpoint": pair.target_viewpoint,
    }
    clock = _Clock()
    matches = correspond(pair.source, pair.target, threads=1, progress=clock.start, **parameters)
    clock.start("overlap")
    sample = overlap_sample(
        pair.source.points, pair.target.points, pair.T_target_source, _resolution(matches), case.rng("sample")
    )
    return Matched(
        case,
        json.dumps(parameters),
        pack(matches),
        _bytes(check_rigid(pair.T_target_source)),
        _bytes(sample),
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
        truth=_bytes(check_rigid(pair.T_target_source)),
        sample=_bytes(sample),
        n=len(matches),
        pr=pr,
        facts=json.dumps(dict(pair.facts)),
    )


def overlap_sample(
    source: FloatArray, target: FloatArray, truth: FloatArray, pr: float, rng: np.random.Generator
) -> FloatArray:
    """Source points that lie close to the target under the true pose.

    Parameters
    ----------
    source, target : (N,3) and (M,3) array of float64
        Whole clouds.
    truth : (4,4) array of float64
        True pose.
    pr : float
        Resolution; close is within `OVERLAP_WITHIN` of it.
    rng : Generator
        Draws the points that are tried.

    Returns
    -------
    (m,3) array of float64
        At most `OVERLAP_SAMPLE`.
    """
    tried = source[rng.permutation(len(source))[: _CANDIDATES_PER_SAMPLE * OVERLAP_SAMPLE]]
    close = within(_moved(tried, truth), target, OVERLAP_WITHIN * pr)
    return tried[close][:OVERLAP_SAMPLE]


@functools.lru_cache(maxsize=8)
def _dataset(name: str, root: str | None) -> Dataset:
    return open_dataset(name, None if root is None else Path(root))


@functools.lru_cache(maxsize=_PAIRS_KEPT)
def _pair(dataset: str, name: str, root: str | None) -> MatchingPair | CorrespondencePair:
    return _dataset(dataset, root).load(name)


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
            np.packbits(grouping.mask).tobytes(),
            seconds,
            grouping.threshold,
            _pose(grouping),
            json.dumps(grouping.diagnostics, default=float),
        )
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this pair and method alone
        return Grouped(case_key, method.key, error=_told(error))


def _pose(grouping: Grouping) -> bytes | None:
    try:
        return _bytes(grouping.transform())
    except NoConsensusError:
        return None


# --- score ---------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Truth:
    """What the groups of one case are judged against.

    Attributes
    ----------
    case_key : str
        Which case.
    pose : (4,4) array of float64
        True pose.
    errors : (n,) array of float64
        Distance of each match from its true place, in pr.
    sample : (m,3) array of float64
        Source points in the overlap.
    pr : float
        Resolution.
    protocols : tuple of str
        Criteria of registration to judge by.
    """

    case_key: str
    pose: FloatArray
    errors: FloatArray
    sample: FloatArray
    pr: float
    protocols: tuple[str, ...]

    @classmethod
    def of(
        cls, case_key: str, content: bytes, truth: bytes, sample: bytes, protocols: tuple[str, ...]
    ) -> Truth:
        """Unpack what the first stage recorded."""
        matches, pose = unpack(content), _array(truth, (4, 4))
        pr = _resolution(matches)
        errors = match_errors(matches.source, matches.target, pose) / pr
        return cls(case_key, pose, errors, _array(sample, (-1, 3)), pr, protocols)


def score_grouping(
    truth: Truth, method_key: str, mask: bytes, pose: bytes | None, epsilons: Sequence[float]
) -> list[Scored]:
    """Judge one group at several thresholds.

    Parameters
    ----------
    truth : Truth
        Of the case.
    method_key : str
        Which method made the group.
    mask, pose : bytes
        As the second stage recorded them.
    epsilons : sequence of float
        Thresholds in pr.

    Returns
    -------
    list of Scored
        One per threshold.
    """
    group = unpack_mask(mask, len(truth.errors))
    errors = _pose_errors(truth, None if pose is None else _array(pose, (4, 4)))
    return [_scored(truth, method_key, group, errors, epsilon) for epsilon in epsilons]


def _scored(
    truth: Truth,
    method_key: str,
    group: BoolArray,
    errors: tuple[float, float, float] | None,
    epsilon: float,
) -> Scored:
    score = score_group(group, truth.errors <= epsilon)
    # A group that fixes no pose is as far off as can be.
    rotation, translation, rmse = (np.inf, np.inf, np.inf) if errors is None else errors
    judged = {
        name: PROTOCOLS[name].judge(score.precision, rotation, translation, rmse) for name in truth.protocols
    }
    measured = (None, None, None) if errors is None else (rotation, translation, _known(rmse))
    counts = (score.correct, score.selected, score.selected_correct)
    return Scored(truth.case_key, method_key, epsilon, *counts, *measured, json.dumps(judged))


def _pose_errors(truth: Truth, pose: FloatArray | None) -> tuple[float, float, float] | None:
    """Rotation in degrees, translation in the data's unit, mean displacement of the overlap in pr."""
    if pose is None:
        return None
    gap = np.linalg.norm(_moved(truth.sample, pose) - _moved(truth.sample, truth.pose), axis=1)
    rmse = float(gap.mean() / truth.pr) if len(gap) else float("nan")
    return rotation_error(pose, truth.pose), translation_error(pose, truth.pose), rmse


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None


# --- packing -------------------------------------------------------------------------------------


def pack(correspondences: Correspondences) -> bytes:
    """Correspondences as the bytes of an NPZ file, the same for the same numbers."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        for name in ("source", "target", *OPTIONAL_FIELDS):
            value = getattr(correspondences, name)
            if value is not None:
                # Without a date of its own the entry would bear the time of day.
                with archive.open(zipfile.ZipInfo(f"{name}.npy"), "w") as entry:
                    np.lib.format.write_array(entry, np.asarray(value, dtype=np.float64))
    return buffer.getvalue()


def unpack(content: bytes) -> Correspondences:
    """Correspondences from `pack`."""
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        fields: dict[str, Any] = {name: archive[name] for name in archive.files}
    if "resolution" in fields:
        fields["resolution"] = float(fields["resolution"])
    return Correspondences(fields.pop("source"), fields.pop("target"), **fields)


def unpack_mask(packed: bytes, n: int) -> BoolArray:
    """Group from its bits: (n,) array of bool."""
    return np.unpackbits(np.frombuffer(packed, dtype=np.uint8), count=n).astype(bool)


def _bytes(array: FloatArray) -> bytes:
    return np.ascontiguousarray(array, dtype=np.float64).tobytes()


def _array(content: bytes, shape: tuple[int, ...]) -> FloatArray:
    return np.frombuffer(content, dtype=np.float64).reshape(shape)


def _moved(points: FloatArray, pose: FloatArray) -> FloatArray:
    return points @ pose[:3, :3].T + pose[:3, 3]


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
