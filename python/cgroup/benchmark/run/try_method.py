"""One method on one problem, measured alone; it runs in another process."""

from __future__ import annotations

import ctypes
import gc
import json
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup.benchmark.records.types import PoseErrors, TrialRecord
from cgroup.benchmark.run.scoring import measure_pose, none_unless_finite
from cgroup.benchmark.run.stages import describe_error
from cgroup.evaluation import score_group
from cgroup.registration.poses import group_poses
from cgroup.registry import METHOD_INFO

if TYPE_CHECKING:
    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.run.problems import PreparedProblem
    from cgroup.types import Correspondences, FloatArray, Grouping

REPEATS, REPEATED_FOR = 3, 0.1
"""A call is repeated so often at most, and only while all together take fewer seconds."""

_STATUS, _CLEAR_REFS = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_RESET_PEAK = "5"
_MMAP_THRESHOLD, _LARGE_BLOCK = -3, 1 << 17  # glibc's name of the option; bytes


def make_ready() -> None:
    """Do nothing: once it is called, the process runs and has imported what methods need."""


def try_method(record: TrialRecord, method: Candidate, problem: PreparedProblem) -> TrialRecord:
    """Run a method on a problem.

    Parameters
    ----------
    record : TrialRecord
        Says which problem, on how many threads, and what the problem is like.
    method : Candidate
        Which method.
    problem : PreparedProblem
        The problem itself.

    Returns
    -------
    TrialRecord
        With all that came of it, or the error.
    """
    lacking = _find_lacking(method, problem.matches)
    if lacking:
        return _filled(record, skipped=f"needs {lacking}, which these matches lack")
    try:
        grouping, seconds, mebibytes = _measure(method, problem.matches, record.case.seed, record.threads)
        judged = _judge(grouping, problem)
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this problem and method alone
        return _filled(record, error=describe_error(error))
    return _filled(record, seconds=seconds, mebibytes=mebibytes, **judged)


def _filled(record: TrialRecord, **known: Any) -> TrialRecord:  # noqa: ANN401 - fields of the record
    """Return the record with what is known now; it bears the time of now."""
    fields = {name: value for name, value in vars(record).items() if name != "provenance"}
    return TrialRecord(**{**fields, **known})


def _find_lacking(method: Candidate, matches: Correspondences) -> str:
    """Name a field that a method needs and matches lack; "" where there is none."""
    info = METHOD_INFO.get(method.name)
    return next((name for name in info.fields if getattr(matches, name) is None), "") if info else ""


def _measure(
    method: Candidate, matches: Correspondences, seed: int, threads: int
) -> tuple[Grouping, float, float | None]:
    """Group; return also seconds, without those of the first call if there are others, and peak memory."""
    cores = None if threads == 0 else threads

    def run() -> tuple[Grouping, float]:
        start = time.perf_counter()
        grouping = method.run(matches, seed=seed, threads=cores)
        return grouping, time.perf_counter() - start

    before = _reset_peak()
    grouping, first = run()
    peak = _memory("VmHWM")
    further: list[float] = []
    while first + sum(further) < REPEATED_FOR and len(further) < REPEATS - 1:
        further.append(run()[1])
    taken = None if before is None or peak is None else max(0.0, peak - before)
    return grouping, float(np.median(further or [first])), taken


def _judge(grouping: Grouping, problem: PreparedProblem) -> dict[str, Any]:
    score = score_group(grouping.mask, problem.correct)
    poses = group_poses(grouping)
    pose = grouping.model if grouping.model is not None else next(iter(poses), None)
    return {
        "selected": score.selected,
        "selected_correct": score.selected_correct,
        "posed": pose is not None,
        "ok": getattr(grouping, "ok", None),
        "complete": grouping.complete,
        "errors": _find_errors(pose, problem),
        "best": _find_best(poses, problem),
        "offered": len(poses),
        "diagnostics": json.dumps(grouping.diagnostics, default=float),
    }


def _find_best(poses: FloatArray, problem: PreparedProblem) -> PoseErrors:
    """Find the errors of the pose that is nearest to the true one over the overlap."""
    errors = [_find_errors(pose, problem) for pose in poses]
    known = [each for each in errors if each.rmse is not None]
    return min(known, key=lambda each: each.rmse or 0.0, default=PoseErrors())


def _find_errors(pose: FloatArray | None, problem: PreparedProblem) -> PoseErrors:
    if pose is None or problem.truth is None:
        return PoseErrors()
    errors = measure_pose(pose, problem.truth, problem.sample, problem.pr)
    return PoseErrors(*(none_unless_finite(error) for error in errors))


def _reset_peak() -> float | None:
    """Hand freed memory back, forget the peak so far, and return what is in use, in MiB."""
    gc.collect()
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        # Else glibc keeps larger and larger blocks for the next call, which then seems to take none.
        library.mallopt(_MMAP_THRESHOLD, _LARGE_BLOCK)
        library.malloc_trim(0)
    try:
        _CLEAR_REFS.write_text(_RESET_PEAK, encoding="ascii")
    except OSError:
        return None
    return _memory("VmRSS")


def _memory(field: str) -> float | None:
    """One of the system's numbers on this process's memory, in MiB; None where it doesn't tell."""
    with suppress(OSError):
        for line in _STATUS.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith(f"{field}:"):
                return int(line.split()[1]) / 1024
    return None
