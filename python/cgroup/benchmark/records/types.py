"""What the stages return, one record each."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import TYPE_CHECKING

from cgroup import __version__
from cgroup.benchmark.records.machine import Machine, this_machine

if TYPE_CHECKING:
    from cgroup.benchmark.cases import Case, PairCase, Problem


def _now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")


@dataclass(frozen=True)
class Provenance:
    """Where and when a record was made."""

    version: str = __version__
    machine: Machine = field(default_factory=this_machine)
    created: str = field(default_factory=_now)


@dataclass(frozen=True)
class MatchingRecord:
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
class GroupingRecord:
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
class ScoreRecord:
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


@dataclass(frozen=True)
class RegistrationRecord:
    """Record of a pair that a pipeline has registered.

    Attributes
    ----------
    case : PairCase
        What was asked for.
    pipeline_key : str
        By which pipeline.
    threads : int
        On how many threads.
    voxel, pr : float
        Edge length of the voxels, and resolution, in the data's unit.
    overlap : float, optional
        Share that both clouds have in common, where it is known.
    pose : bytes, optional
        16 float64; None where the pipeline found none.
    ok : bool
        Whether the pipeline holds its pose to be right.
    probability : float, optional
        That it is, where the pipeline says so.
    rotation_error, translation_error, rmse : float, optional
        Degrees, the data's unit, pr; None without a pose or a true one.
    seconds : str
        JSON: wall time of each stage.
    error : str
        Type and message; empty where all went well.
    """

    case: PairCase
    pipeline_key: str
    threads: int
    voxel: float = float("nan")
    pr: float = float("nan")
    overlap: float | None = None
    pose: bytes | None = None
    ok: bool = False
    probability: float | None = None
    rotation_error: float | None = None
    translation_error: float | None = None
    rmse: float | None = None
    seconds: str = "{}"
    error: str = ""
    provenance: Provenance = field(default_factory=Provenance)


@dataclass(frozen=True)
class PoseErrors:
    """How far a pose is off: degrees, the data's unit, and pr over the overlap; None where it isn't known."""

    rotation: float | None = None
    translation: float | None = None
    rmse: float | None = None


@dataclass(frozen=True)
class TrialRecord:
    """Record of a method that was run alone on matches.

    Attributes
    ----------
    case : Problem
        On which.
    method_key : str
        Which method.
    threads : int
        On how many threads; 0 for all cores.
    limit : float
        Seconds that it was given.
    n, correct : int
        Matches, and how many are correct.
    resolution, pr : float
        Unit of the matches, and mean distance of neighbours in the clouds, in the data's unit.
    overlap : float, optional
        Share that the clouds have in common, where it is known.
    selected, selected_correct : int
        Counts of the group.
    posed : bool
        Whether there is a pose: the method's model, or the least-squares pose of the group.
    ok : bool, optional
        Whether the method holds it to be right; None where it doesn't say.
    complete : bool
        Whether the search ran to its end.
    errors : PoseErrors
        Of the pose.
    best : PoseErrors
        Of the best of all poses that the method offers, by the truth.
    offered : int
        How many those are.
    seconds : float
        Wall time of the grouping alone.
    mebibytes : float, optional
        Peak memory that it took beside the matches; None where the system doesn't tell.
    diagnostics : str
        JSON of the method's own facts.
    skipped : str
        Why it wasn't run, or not to its end; empty where it was.
    error : str
        Type and message; empty where all went well.
    """

    case: Problem
    method_key: str
    threads: int
    limit: float
    n: int = 0
    correct: int = 0
    resolution: float = float("nan")
    pr: float = float("nan")
    overlap: float | None = None
    selected: int = 0
    selected_correct: int = 0
    posed: bool = False
    ok: bool | None = None
    complete: bool = True
    errors: PoseErrors = field(default_factory=PoseErrors)
    best: PoseErrors = field(default_factory=PoseErrors)
    offered: int = 0
    seconds: float = float("nan")
    mebibytes: float | None = None
    diagnostics: str = "{}"
    skipped: str = ""
    error: str = ""
    provenance: Provenance = field(default_factory=Provenance)
