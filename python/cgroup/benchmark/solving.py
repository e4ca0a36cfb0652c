"""Run solvers on a problem and judge their answers, mostly in worker processes.

An error of a solver or a problem becomes part of the result.
"""

import ctypes
import functools
import gc
import json
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from cgroup import features
from cgroup.benchmark.pipelines import Clouds, Scans
from cgroup.benchmark.problem import AND, LoadedProblem, Problem, known_resolution, open_once
from cgroup.benchmark.results import (
    ERRORS,
    Matched,
    Pending,
    Result,
    describe_error,
    none_unless_finite,
    unpack,
)
from cgroup.benchmark.solver import Solver
from cgroup.datasets.scan_sets import ScanSet, load_scan_set
from cgroup.errors import NoConsensusError
from cgroup.evaluation import match_errors, rotation_error, score_group, score_scene, translation_error
from cgroup.fronts.matching import group_poses
from cgroup.registry import METHOD_INFO
from cgroup.rigid import apply, invert
from cgroup.rigid.se3 import vector_of
from cgroup.types import BoolArray, FloatArray, Grouping, RealArray

# Most calls of a method on matches, and seconds after which a call is not repeated
REPEATS, REPEATED_FOR = 3, 0.1
SHORTEST = 0.02  # in the timing, shorter calls are repeated in a row, in seconds
_SCAN_VOXELS = 4500  # to which each scan of many is downsampled, about

_STATUS, _CLEAR_REFS = Path("/proc/self/status"), Path("/proc/self/clear_refs")
_RESET_PEAK = "5"
_MMAP_THRESHOLD, _LARGE_BLOCK = -3, 1 << 17  # glibc's name of the option; bytes


class Outcome(NamedTuple):
    """Pose or poses if there are any, further numbers, seconds and group of a solver."""

    pose: FloatArray | None
    numbers: dict[str, Any]
    seconds: float | None = None
    mask: bytes | None = None
    skipped: str = ""


# Numbers of the problem itself, and a function that runs a solver on it
Prepared: TypeAlias = tuple[dict[str, Any], Callable[[Solver], Outcome]]


def solve(pending: Pending, given: Matched | bytes | None, root: str | None) -> list[Result]:
    """Run the solvers of a problem one after another.

    `given` are the matches of problems that have some. `root` is the folder with the data.
    """
    try:
        if given is not None:
            known, run = _prepare_matches(pending, unpack(given) if isinstance(given, bytes) else given)
        else:
            prepare = _prepare_scans if pending.problem.task == "scenes" else _prepare_clouds
            known, run = prepare(pending.problem, pending.threads, root)
    except Exception as error:  # noqa: BLE001 - errors of any kind concern this problem only
        return pending.fail(describe_error(error))
    return [_run(pending, each, known, run) for each in pending.solvers]


def _run(pending: Pending, solver: Solver, known: dict[str, Any], run: Callable[[Solver], Outcome]) -> Result:
    try:
        found = run(solver)
        numbers = json.dumps(known | found.numbers, default=float)
    except Exception as error:  # noqa: BLE001 - errors of any kind concern this problem and solver only
        return pending.result(solver, numbers=json.dumps(known), error=describe_error(error))
    pose = None if found.pose is None else found.pose.astype(np.float64).tobytes()
    return pending.result(
        solver, seconds=found.seconds, mask=found.mask, pose=pose, numbers=numbers, skipped=found.skipped
    )


def measure_pose(
    pose: FloatArray, truth: FloatArray, sample: RealArray, pr: float
) -> tuple[float, float, float]:
    """Return the `ERRORS` of a pose; the last is NaN without a sample."""
    gap = np.linalg.norm(apply(pose, sample) - apply(truth, sample), axis=1)
    rmse = float(gap.mean() / pr) if len(gap) else math.nan
    return rotation_error(pose, truth), translation_error(pose, truth), rmse


def _name_errors(
    pose: FloatArray | None, truth: FloatArray | None, sample: RealArray, pr: float, prefix: str = ""
) -> dict[str, float | None]:
    if pose is None or truth is None:
        return {}
    errors = measure_pose(pose, truth, sample, pr)
    return {prefix + name: none_unless_finite(error) for name, error in zip(ERRORS, errors, strict=True)}


def _as_list(pose: FloatArray | None) -> list[list[float]] | None:
    return None if pose is None else pose.tolist()


# --- grouping methods on matches -------------------------------------------------------------------


def known_json(matched: Matched, epsilons: tuple[float, ...]) -> str:
    """Return the numbers of the matches themselves as JSON."""
    return json.dumps(_describe_matches(matched, find_correct(matched, epsilons)), default=float)


def _describe_matches(matched: Matched, correct: dict[float, BoolArray]) -> dict[str, Any]:
    return {
        "n": len(matched.matches),
        "correct": {str(epsilon): int(found.sum()) for epsilon, found in correct.items()},
        "resolution": matched.matches.resolution,
        "pr": matched.pr,
        **matched.facts,
        "truth": _as_list(matched.truth),
    }


def find_correct(matched: Matched, epsilons: tuple[float, ...]) -> dict[float, BoolArray]:
    """Return the correct matches at thresholds in resolutions of the matches."""
    matches = matched.matches
    resolution = known_resolution(matches.resolution)
    errors = np.full(len(matches), np.inf)
    if matched.truth is not None:
        errors = match_errors(matches.source, matches.target, matched.truth)
    return {epsilon: errors <= epsilon * resolution for epsilon in epsilons}


def _prepare_matches(pending: Pending, matched: Matched) -> Prepared:
    correct = find_correct(matched, pending.epsilons)
    work = {"experiment": _group, "timing": _time, "matches": _try}[pending.problem.task]
    return _describe_matches(matched, correct), lambda solver: work(pending, matched, correct, solver)


def _group(pending: Pending, matched: Matched, correct: dict[float, BoolArray], method: Solver) -> Outcome:
    """Group once while other workers run; the pose is the least-squares pose of the whole group."""
    start = time.perf_counter()
    grouping = method.group(matched.matches, seed=pending.problem.seed, threads=pending.threads)
    seconds = time.perf_counter() - start
    pose = None
    with suppress(NoConsensusError):
        pose = grouping.transform()
    mask = np.packbits(grouping.mask).tobytes()
    return Outcome(pose, _judge(grouping, matched, correct, pose), seconds, mask)


def _try(pending: Pending, matched: Matched, correct: dict[float, BoolArray], method: Solver) -> Outcome:
    """Group while no other worker runs; measure time and memory, and take the method's first pose."""
    info = METHOD_INFO.get(method.name)
    for field in info.fields if info else ():
        if getattr(matched.matches, field) is None:
            return Outcome(None, {}, skipped=f"needs {field}, which these matches lack")
    grouping, seconds, mebibytes = _measure(pending, matched, method)
    pose = grouping.model if grouping.model is not None else next(iter(group_poses(grouping)), None)
    return Outcome(pose, _judge(grouping, matched, correct, pose) | {"mebibytes": mebibytes}, seconds)


def _time(pending: Pending, matched: Matched, _correct: dict[float, BoolArray], method: Solver) -> Outcome:
    """Time repeated calls after a warm-up call."""
    threads, seed = pending.threads or None, pending.problem.seed
    repeats = pending.problem.repeats
    seconds = measure(lambda: method.group(matched.matches, seed=seed, threads=threads), repeats)
    return Outcome(None, {"repeats": seconds}, float(np.median(seconds)))


def _judge(
    grouping: Grouping, matched: Matched, correct: dict[float, BoolArray], pose: FloatArray | None
) -> dict[str, Any]:
    """Return counts of the group, errors of its pose, and errors of the method's best pose."""
    poses = group_poses(grouping)
    truth = matched.truth, matched.sample, matched.pr
    offered = [_name_errors(each, *truth, "best_") for each in poses]
    known = [each for each in offered if each.get("best_rmse_pr") is not None]
    best = min(known, key=lambda each: each["best_rmse_pr"] or 0.0, default={})
    scores = {str(epsilon): score_group(grouping.mask, found) for epsilon, found in correct.items()}
    return {
        "selected": int(grouping.mask.sum()),
        "selected_correct": {epsilon: score.selected_correct for epsilon, score in scores.items()},
        "posed": pose is not None,
        "ok": getattr(grouping, "ok", None),
        "complete": grouping.complete,
        **_name_errors(pose, *truth),
        **best,
        "offered": len(poses),
        "diagnostics": json.dumps(grouping.diagnostics, default=float),
    }


def measure(call: Callable[[], object], repeats: int) -> list[float]:
    """Return the seconds of one call per repeat, after a warm-up call.

    Calls shorter than `SHORTEST` are repeated in a row and averaged.
    """
    warm_up = _time_calls(call, 1)
    in_a_row = max(1, math.ceil(SHORTEST / max(warm_up, 1e-6)))
    return [_time_calls(call, in_a_row) for _ in range(repeats)]


def fit_exponent(n: Sequence[float], seconds: Sequence[float]) -> float:
    """Return a in ``seconds ~ n^a`` by least squares in logarithms; NaN for fewer than two sizes."""
    if len(set(n)) < 2:
        return math.nan
    return float(np.polyfit(np.log(n), np.log(seconds), 1)[0])


def _time_calls(call: Callable[[], object], times: int) -> float:
    start = time.perf_counter()
    for _ in range(times):
        call()
    return (time.perf_counter() - start) / times


def _measure(pending: Pending, matched: Matched, method: Solver) -> tuple[Grouping, float, float | None]:
    """Group; return also seconds, without the first call if there are several, and peak memory in MiB."""

    def run() -> tuple[Grouping, float]:
        start = time.perf_counter()
        seed, threads = pending.problem.seed, pending.threads or None
        grouping = method.group(matched.matches, seed=seed, threads=threads)
        return grouping, time.perf_counter() - start

    before = _reset_peak()
    grouping, first = run()
    peak = _memory("VmHWM")
    further: list[float] = []
    while first + sum(further) < REPEATED_FOR and len(further) < REPEATS - 1:
        further.append(run()[1])
    taken = None if before is None or peak is None else max(0.0, peak - before)
    return grouping, float(np.median(further or [first])), taken


def _reset_peak() -> float | None:
    """Return freed memory to the system, reset the peak, and return the memory in use, in MiB."""
    gc.collect()
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        # Otherwise glibc keeps larger and larger blocks, and the next call seems to need no memory.
        library.mallopt(_MMAP_THRESHOLD, _LARGE_BLOCK)
        library.malloc_trim(0)
    try:
        _CLEAR_REFS.write_text(_RESET_PEAK, encoding="ascii")
    except OSError:
        return None
    return _memory("VmRSS")


def _memory(field: str) -> float | None:
    """Return a memory counter of this process in MiB; None if the system does not have it."""
    with suppress(OSError):
        for line in _STATUS.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith(f"{field}:"):
                return int(line.split()[1]) / 1024
    return None


# --- pipelines on clouds and scans -----------------------------------------------------------------


@functools.lru_cache(maxsize=1)  # the next solver usually runs on the same problem
def _prepare_clouds(problem: Problem, threads: int, root: str | None) -> Prepared:
    loaded = problem.load(root)
    source, target = (np.asarray(points, dtype=np.float64) for points in loaded.points)
    clouds = loaded.clouds
    assert clouds is not None  # noqa: S101 - loading has checked it
    known = open_once(problem.dataset, root).single_views
    viewpoints = (clouds.source_viewpoint, clouds.target_viewpoint) if known else (None, None)
    voxel = problem.voxel or features.choose_voxel(source, target)
    given = Clouds(source, target, *viewpoints, voxel, threads, problem.seed)
    pr = loaded.measure_pr()
    sample = loaded.draw_sample(pr, problem.rng("sample"))
    numbers = {"voxel": voxel, "pr": pr, **loaded.facts, "truth": _as_list(loaded.truth)}
    return numbers, lambda solver: _register(solver, given, loaded, sample, pr)


def _register(solver: Solver, given: Clouds, loaded: LoadedProblem, sample: RealArray, pr: float) -> Outcome:
    answer, seconds = solver.register(given)
    pose, truth = answer.T_target_source, loaded.truth
    numbers: dict[str, Any] = _name_errors(pose, truth, sample, pr)
    numbers["ok"] = bool(answer.ok) and pose is not None
    numbers["probability"] = none_unless_finite(answer.probability)
    numbers["decoy"] = none_unless_finite(answer.decoy)
    if pose is not None and answer.covariance is not None and truth is not None:
        error = vector_of(truth @ invert(pose), np.zeros(3))
        numbers["nees"] = none_unless_finite(float(error @ np.linalg.solve(answer.covariance, error)))
    return Outcome(pose, *_add_stages(numbers, seconds))


@functools.lru_cache(maxsize=1)
def _prepare_scans(problem: Problem, threads: int, root: str | None) -> Prepared:
    folder = None if root is None else Path(root)
    mirrored = problem.kind == "mirrored"
    bag = load_scan_set(problem.dataset.split(AND), folder, problem.seed, mirrored=mirrored)
    voxel = features.choose_voxel(*(features.Cloud(points) for points in bag.scans), voxels=_SCAN_VOXELS)
    given = Scans(bag.scans, voxel, threads, problem.seed)
    return {"voxel": voxel, "scans": len(bag.scans)}, lambda solver: _register_scans(solver, given, bag)


def _register_scans(solver: Solver, given: Scans, bag: ScanSet) -> Outcome:
    answer, seconds = solver.register(given)
    score = score_scene(answer.poses, answer.components, bag.truth, bag.labels)
    numbers: dict[str, Any] = vars(score) | {"tried": answer.tried}
    for name in ("rotation", "translation"):
        numbers[name] = [none_unless_finite(float(f"{error:.6g}")) for error in numbers[name]]
    return Outcome(answer.poses, *_add_stages(numbers, seconds))


def _add_stages(numbers: dict[str, Any], seconds: dict[str, float]) -> tuple[dict[str, Any], float | None]:
    """Return the numbers with the seconds of each stage, and their sum."""
    stages = {stage: round(value, 6) for stage, value in seconds.items()}
    return numbers | {"stages": stages}, sum(stages.values()) if stages else None
