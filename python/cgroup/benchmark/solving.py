"""Solvers at work on one problem, and their answers judged; most of it runs in other processes.

Functions that workers call turn errors of one problem and solver into a result of its own.
"""

from __future__ import annotations

import ctypes
import gc
import json
import time
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from cgroup import features
from cgroup.benchmark.pipelines import Clouds, Scans
from cgroup.benchmark.problem import AND, known_resolution, open_once
from cgroup.benchmark.results import (
    Result,
    Score,
    describe_error,
    floats_as_bytes,
    floats_from_bytes,
    none_unless_finite,
    pack_mask,
    unpack,
    unpack_mask,
)
from cgroup.datasets.scan_sets import load_scan_set
from cgroup.errors import NoConsensusError
from cgroup.evaluation import match_errors, rotation_error, score_group, score_scene, translation_error
from cgroup.evaluation.protocols import PROTOCOLS
from cgroup.registration.matching import group_poses
from cgroup.registry import METHOD_INFO
from cgroup.rigid import apply, invert
from cgroup.rigid.se3 import vector_of

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from cgroup.benchmark.matching import PreparedMatches
    from cgroup.benchmark.problem import Problem
    from cgroup.benchmark.solver import Solver
    from cgroup.types import Correspondences, FloatArray, Grouping, RealArray

REPEATS, REPEATED_FOR = 3, 0.1
"""A call on matches is repeated so often at most, and only while all together take fewer seconds."""

ERRORS = ("rotation_error", "translation_error", "rmse_pr")
"""Errors of a pose: in degrees, in the data's unit, and the mean displacement over the overlap in pr."""

_SCAN_VOXELS = 4500  # that a scan of many is thinned to, about

_STATUS, _CLEAR_REFS = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_RESET_PEAK = "5"
_MMAP_THRESHOLD, _LARGE_BLOCK = -3, 1 << 17  # glibc's name of the option; bytes


def measure_pose(
    pose: FloatArray, truth: FloatArray, sample: RealArray, pr: float
) -> tuple[float, float, float]:
    """Errors of a pose, as in `ERRORS`; the last is NaN without a sample."""
    gap = np.linalg.norm(apply(pose, sample) - apply(truth, sample), axis=1)
    rmse = float(gap.mean() / pr) if len(gap) else float("nan")
    return rotation_error(pose, truth), translation_error(pose, truth), rmse


def _name_errors(
    pose: FloatArray | None, truth: FloatArray | None, sample: RealArray, pr: float, prefix: str = ""
) -> dict[str, float | None]:
    """Errors of a pose by name; none where there is no true pose."""
    if pose is None or truth is None:
        return {}
    errors = measure_pose(pose, truth, sample, pr)
    return {prefix + name: none_unless_finite(error) for name, error in zip(ERRORS, errors, strict=True)}


# --- experiments: group, then score ----------------------------------------------------------------


def group_problem(problem: str, seed: int, content: bytes, methods: Sequence[Solver]) -> list[Result]:
    """Run methods on one thread on the packed matches of a problem; return nothing if they can't be read."""
    try:
        matches = unpack(content)
    except Exception:  # noqa: BLE001 - whatever became of the bytes, they can be made again
        return []
    return [_group(problem, seed, matches, method) for method in methods]


def _group(problem: str, seed: int, matches: Correspondences, method: Solver) -> Result:
    try:
        parameters = {"method": method.name, "options": method.parameters(seed, matches.resolution)}
        start = time.perf_counter()
        grouping = method.group(matches, seed=seed)
        seconds = time.perf_counter() - start
        pose = None
        with suppress(NoConsensusError):
            pose = floats_as_bytes(grouping.transform())
        diagnostics = dict(grouping.diagnostics)
        numbers = {"threshold": grouping.threshold, "diagnostics": diagnostics, "parameters": parameters}
        return Result(
            problem,
            method.key,
            seconds=seconds,
            mask=pack_mask(grouping.mask),
            pose=pose,
            numbers=json.dumps(numbers, default=float),
        )
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this problem and method alone
        return Result(problem, method.key, error=describe_error(error))


@dataclass(frozen=True, eq=False)
class Truth:
    """Truth about the matches of a problem: true pose, distance of each match from its true place in pr.

    `sample` are source points in the overlap, `pr` is the resolution, `protocols` are criteria to judge by.
    """

    problem: str
    pose: FloatArray
    errors: FloatArray
    sample: FloatArray
    pr: float
    protocols: tuple[str, ...]


def unpack_truth(
    problem: str, content: bytes, truth: bytes, sample: bytes, protocols: tuple[str, ...]
) -> Truth | None:
    """Unpack the arrays of a matched problem; None if they can't be read."""
    try:
        matches, pose = unpack(content), floats_from_bytes(truth, (4, 4))
        pr = known_resolution(matches.resolution)
        errors = match_errors(matches.source, matches.target, pose) / pr
        return Truth(problem, pose, errors, floats_from_bytes(sample, (-1, 3)), pr, protocols)
    except Exception:  # noqa: BLE001 - whatever became of the bytes, they can be made again
        return None


def score_grouping(
    truth: Truth, solver: str, mask: bytes, pose: bytes | None, epsilons: Sequence[float]
) -> list[Score]:
    """Judge a packed group and its pose at thresholds in pr."""
    group = unpack_mask(mask, len(truth.errors))
    # A group that fixes no pose is as far off as can be.
    errors, known = (np.inf, np.inf, np.inf), (None, None, None)
    if pose is not None:
        errors = measure_pose(floats_from_bytes(pose, (4, 4)), truth.pose, truth.sample, truth.pr)
        known = (*errors[:2], none_unless_finite(errors[2]))
    scores: list[Score] = []
    for epsilon in epsilons:
        score = score_group(group, truth.errors <= epsilon)
        verdicts = {name: PROTOCOLS[name].judge(score.precision, *errors) for name in truth.protocols}
        counts = (score.correct, score.selected, score.selected_correct)
        scores.append(Score(truth.problem, solver, epsilon, *counts, *known, json.dumps(verdicts)))
    return scores


# --- registration ----------------------------------------------------------------------------------

Outcome: TypeAlias = "tuple[FloatArray | None, dict[str, Any], dict[str, float]]"
"""Pose or poses, if any; numbers; and seconds of each stage."""


def register(problem: Problem, threads: int, solvers: Sequence[Solver], root: str | None) -> list[Result]:
    """Register two clouds or many scans by one solver after the other; `root` is the folder with the data."""
    load = _load_scans if problem.task == "scenes" else _load_clouds
    try:
        known, solve = load(problem, threads, root)
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this problem alone
        message = describe_error(error)
        return [Result(problem.key, each.key, threads, error=message) for each in solvers]
    results: list[Result] = []
    for each in solvers:
        result = partial(Result, problem.key, each.key, threads)
        try:
            pose, numbers, seconds = solve(each)
        except Exception as error:  # noqa: BLE001 - whatever it is concerns this problem and solver alone
            results.append(result(numbers=json.dumps(known), error=describe_error(error)))
            continue
        stages = {stage: round(value, 6) for stage, value in seconds.items()}
        results.append(
            result(
                seconds=sum(stages.values()) if stages else None,
                pose=None if pose is None else floats_as_bytes(pose),
                numbers=json.dumps(known | numbers | {"stages": stages}),
            )
        )
    return results


def _load_clouds(
    problem: Problem, threads: int, root: str | None
) -> tuple[dict[str, Any], Callable[[Solver], Outcome]]:
    """Return what is known of two clouds, and what registers them."""
    loaded = problem.load(root)
    source, target = (np.asarray(points, dtype=np.float64) for points in loaded.points)
    clouds = loaded.clouds
    assert clouds is not None  # noqa: S101 - loading has seen to that
    told = open_once(problem.dataset, root).single_views
    given = Clouds(
        source,
        target,
        clouds.source_viewpoint if told else None,
        clouds.target_viewpoint if told else None,
        problem.voxel or features.choose_voxel(source, target),
        threads,
        problem.seed,
    )
    pr = loaded.measure_pr()
    sample = loaded.draw_sample(pr, problem.rng("sample"))

    def solve(solver: Solver) -> Outcome:
        answer, seconds = solver.register(given)
        pose = answer.T_target_source
        numbers: dict[str, Any] = _name_errors(pose, loaded.truth, sample, pr)
        numbers["ok"] = bool(answer.ok) and pose is not None
        numbers["probability"] = none_unless_finite(answer.probability)
        if pose is not None and answer.covariance is not None and loaded.truth is not None:
            error = vector_of(loaded.truth @ invert(pose), np.zeros(3))
            numbers["nees"] = none_unless_finite(float(error @ np.linalg.solve(answer.covariance, error)))
        return pose, numbers, seconds

    known = {"voxel": given.voxel, "pr": pr, "overlap": loaded.overlap, "truth": _as_list(loaded.truth)}
    return known, solve


def _load_scans(
    problem: Problem, threads: int, root: str | None
) -> tuple[dict[str, Any], Callable[[Solver], Outcome]]:
    """Return what is known of many scans, and what registers them."""
    folder = None if root is None else Path(root)
    mirrored = problem.kind == "mirrored"
    bag = load_scan_set(problem.dataset.split(AND), folder, problem.seed, mirrored=mirrored)
    voxel = features.choose_voxel(*(features.Cloud(points) for points in bag.scans), voxels=_SCAN_VOXELS)
    given = Scans(bag.scans, voxel, threads, problem.seed)

    def solve(solver: Solver) -> Outcome:
        answer, seconds = solver.register_scans(given)
        score = score_scene(answer.poses, answer.components, bag.truth, bag.labels)
        numbers: dict[str, Any] = vars(score) | {"tried": answer.tried}
        for name in ("rotation", "translation"):
            numbers[name] = [none_unless_finite(float(f"{error:.6g}")) for error in numbers[name]]
        return answer.poses, numbers, seconds

    return {"voxel": voxel, "scans": len(bag.scans)}, solve


# --- matches, each method alone --------------------------------------------------------------------


def try_method(
    result: Callable[..., Result], method: Solver, seed: int, threads: int, problem: PreparedMatches
) -> Result:
    """Run a method alone on matches, and make a result of all that came of it, or of the error."""
    info = METHOD_INFO.get(method.name)
    for field in info.fields if info else ():
        if getattr(problem.matches, field) is None:
            return result(skipped=f"needs {field}, which these matches lack")
    try:
        grouping, seconds, mebibytes = _measure(method, problem.matches, seed, threads)
        pose, judged = _judge(grouping, problem)
        numbers = describe_matches(problem) | judged | {"mebibytes": mebibytes}
    except Exception as error:  # noqa: BLE001 - whatever it is concerns this problem and method alone
        return result(error=describe_error(error))
    kept = None if pose is None else floats_as_bytes(pose)
    return result(seconds=seconds, pose=kept, numbers=json.dumps(numbers))


def describe_matches(problem: PreparedMatches) -> dict[str, Any]:
    """Numbers of the matches, which stand beside those of every method."""
    return {
        "n": len(problem.matches),
        "correct": int(problem.correct.sum()),
        "resolution": problem.resolution,
        "pr": problem.pr,
        "overlap": problem.overlap,
        "truth": _as_list(problem.truth),
    }


def _as_list(pose: FloatArray | None) -> list[list[float]] | None:
    return None if pose is None else pose.tolist()


def _measure(
    method: Solver, matches: Correspondences, seed: int, threads: int
) -> tuple[Grouping, float, float | None]:
    """Group; return also seconds, without those of the first call if there are others, and peak memory."""
    cores = None if threads == 0 else threads

    def run() -> tuple[Grouping, float]:
        start = time.perf_counter()
        grouping = method.group(matches, seed=seed, threads=cores)
        return grouping, time.perf_counter() - start

    before = _reset_peak()
    grouping, first = run()
    peak = _memory("VmHWM")
    further: list[float] = []
    while first + sum(further) < REPEATED_FOR and len(further) < REPEATS - 1:
        further.append(run()[1])
    taken = None if before is None or peak is None else max(0.0, peak - before)
    return grouping, float(np.median(further or [first])), taken


def _judge(grouping: Grouping, problem: PreparedMatches) -> tuple[FloatArray | None, dict[str, Any]]:
    score = score_group(grouping.mask, problem.correct)
    poses = group_poses(grouping)
    pose = grouping.model if grouping.model is not None else next(iter(poses), None)
    truth = problem.truth, problem.sample, problem.pr
    offered = [_name_errors(each, *truth, "best_") for each in poses]
    known = [each for each in offered if each.get("best_rmse_pr") is not None]
    best = min(known, key=lambda each: each["best_rmse_pr"] or 0.0, default={})
    return pose, {
        "selected": score.selected,
        "selected_correct": score.selected_correct,
        "posed": pose is not None,
        "ok": getattr(grouping, "ok", None),
        "complete": grouping.complete,
        **_name_errors(pose, *truth),
        **best,
        "offered": len(poses),
        "diagnostics": json.dumps(grouping.diagnostics, default=float),
    }


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
