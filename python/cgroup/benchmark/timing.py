"""The paper's timing experiment (section 5.3): seconds of each method over the number of correspondences.

The sets are those of one pair, made larger by a smaller radius of the detector's non-maximum suppression.
Only the grouping is timed, one method after another with nothing else at work.
"""

from __future__ import annotations

import itertools
import json
import math
import time
from contextlib import closing
from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.engine import OutOfTimeError, ProcessDiedError, Worker
from cgroup.benchmark.machine import this_machine
from cgroup.benchmark.matching import match_problems
from cgroup.benchmark.results import KILLED, Result, describe_error, unpack
from cgroup.benchmark.worker import ALL_CORES
from cgroup.errors import CgroupError, InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from typing import Any

    from cgroup.benchmark.config import TimingEntry
    from cgroup.benchmark.plan import PlannedSet
    from cgroup.benchmark.problem import Problem
    from cgroup.benchmark.solver import Solver
    from cgroup.benchmark.store import Store
    from cgroup.types import Correspondences

SHORTEST = 0.02
"""A method that takes fewer seconds is called several times in a row per repeat."""

UNKNOWN_EXPONENT = 2.0
"""Growth that is expected of the seconds with n while only one size has been timed."""


def take_times(
    planned: PlannedSet, timing: TimingEntry, store: Store, root: str | None, progress: Callable[..., Any]
) -> None:
    """Time every method on every set, unless it has been done on this machine."""
    solvers = list(itertools.product(planned.solvers, planned.threads))
    done, wanted = 0, len(planned.problems) * len(solvers)
    progress("time", done, wanted)
    machine = this_machine().id
    medians: dict[tuple[str, int], list[tuple[int, float]]] = {}
    with closing(Worker(ALL_CORES)) as worker:
        for problem in planned.problems:
            matches = _prepare(problem, store, root)
            for method, threads in solvers:
                so_far = medians.setdefault((method.key, threads), [])
                seconds, reason = store.times(problem.key, method.key, threads, machine), ""
                if len(seconds) != timing.repeats:
                    seconds, reason = _try(worker, problem, matches, method, threads, timing, so_far)
                    numbers = json.dumps({"repeats": seconds})
                    result = Result(
                        problem.key, method.key, threads, machine, numbers=numbers, skipped=reason
                    )
                    store.add_results([result])
                if not reason:
                    so_far.append((len(matches), float(np.median(seconds))))
                done += 1
                progress("time", done, wanted)


def time_method(
    method: Solver, given: Correspondences, seed: int, threads: int, repeats: int
) -> tuple[list[float], str]:
    """Return the times of a method, or why there are none; called in another process."""
    cores = None if threads == 0 else threads
    try:
        return measure(lambda: method.group(given, seed=seed, threads=cores), repeats), ""
    except CgroupError as error:
        return [], str(error)
    except Exception as error:  # noqa: BLE001 - of a method from outside
        return [], describe_error(error)


def measure(call: Callable[[], object], repeats: int) -> list[float]:
    """Seconds of one call, for each repeat after a call that isn't counted.

    Of a call shorter than `SHORTEST` each is the mean of several in a row.
    """
    warm_up = _time_calls(call, 1)
    in_a_row = max(1, math.ceil(SHORTEST / max(warm_up, 1e-6)))
    return [_time_calls(call, in_a_row) for _ in range(repeats)]


def fit_exponent(n: Sequence[float], seconds: Sequence[float]) -> float:
    """Exponent a of ``seconds ~ n^a``, by least squares in logarithms; NaN for fewer than two sizes."""
    if len(set(n)) < 2:
        return float("nan")
    return float(np.polyfit(np.log(n), np.log(seconds), 1)[0])


def _try(
    worker: Worker,
    problem: Problem,
    given: Correspondences,
    method: Solver,
    threads: int,
    timing: TimingEntry,
    so_far: Sequence[tuple[int, float]],
) -> tuple[list[float], str]:
    """Return the times, or why there are none; `so_far` are n and seconds on smaller sets."""
    expected = _expect(so_far[-2:], len(given))
    if expected > timing.budget:
        return [], f"expected to take {expected:.0f} s per call, more than {timing.budget:g} s"
    limit = (timing.repeats + 1) * (timing.budget + SHORTEST)
    try:
        return worker.call(time_method, method, given, problem.seed, threads, timing.repeats, limit=limit)
    except OutOfTimeError:
        return [], f"took longer than {timing.budget:g} s per call"
    except ProcessDiedError:
        return [], KILLED


def _expect(known: Sequence[tuple[int, float]], n: int) -> float:
    """Extrapolate the seconds from those of smaller sets."""
    if not known:
        return 0.0
    exponent = fit_exponent(*zip(*known, strict=True))
    size, seconds = known[-1]
    return seconds * (n / size) ** (UNKNOWN_EXPONENT if math.isnan(exponent) else exponent)


def _time_calls(call: Callable[[], object], times: int) -> float:
    start = time.perf_counter()
    for _ in range(times):
        call()
    return (time.perf_counter() - start) / times


def _prepare(problem: Problem, store: Store, root: str | None) -> Correspondences:
    content = store.content(problem.key)
    if content is None:
        [matched] = match_problems([problem], root)
        if matched.error:
            message = f"timing: {problem.dataset} {problem.pair}: {matched.error}"
            raise InputError(message)
        store.add_matched([matched])
        content = matched.content
    return unpack(content)
