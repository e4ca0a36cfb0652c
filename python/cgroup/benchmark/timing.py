"""The paper's timing experiment (section 5.3): seconds of each method over the number of correspondences.

The sets are those of one pair, made larger by a smaller radius of the detector's non-maximum suppression.
Only the grouping is timed, one method after another with nothing else at work.
"""

from __future__ import annotations

import json
import math
import time
from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.machine import this_machine
from cgroup.benchmark.matching import match_problems
from cgroup.benchmark.results import Result, unpack
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
    wanted = len(planned.problems) * len(planned.solvers) * len(planned.threads)
    progress("time", 0, wanted)
    timer = _Timer(timing, store)
    done = 0
    for problem in planned.problems:
        matches = _prepare(problem, store, root)
        for method in planned.solvers:
            for threads in planned.threads:
                timer.take(problem, matches, method, threads)
                done += 1
                progress("time", done, wanted)


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


class _Timer:
    """Takes times, and expects those of larger sets from those of smaller ones."""

    def __init__(self, timing: TimingEntry, store: Store) -> None:
        self._timing = timing
        self._store = store
        self._medians: dict[tuple[str, int], list[tuple[int, float]]] = {}

    def take(self, problem: Problem, given: Correspondences, method: Solver, threads: int) -> None:
        """Time a method on a set, or say why not."""
        machine = this_machine().id
        seconds = self._store.times(problem.key, method.key, threads, machine)
        if len(seconds) != self._timing.repeats:
            seconds, reason = self._try(problem, given, method, threads)
            numbers = json.dumps({"repeats": seconds})
            result = Result(problem.key, method.key, threads, machine, numbers=numbers, skipped=reason)
            self._store.add_results([result])
            if reason:
                return
        self._medians.setdefault((method.key, threads), []).append((len(given), float(np.median(seconds))))

    def _try(
        self, problem: Problem, given: Correspondences, method: Solver, threads: int
    ) -> tuple[list[float], str]:
        """Return the times, or why there are none."""
        expected, budget = self._expect(method, threads, len(given)), self._timing.budget
        if expected > budget:
            return [], f"expected to take {expected:.0f} s per call, more than {budget:g} s"
        cores = None if threads == 0 else threads
        try:
            return measure(
                lambda: method.group(given, seed=problem.seed, threads=cores), self._timing.repeats
            ), ""
        except CgroupError as error:
            return [], str(error)

    def _expect(self, method: Solver, threads: int, n: int) -> float:
        """Extrapolate from the two largest sets so far."""
        so_far = self._medians.get((method.key, threads), [])[-2:]
        if not so_far:
            return 0.0
        exponent = fit_exponent([size for size, _ in so_far], [seconds for _, seconds in so_far])
        if math.isnan(exponent):
            exponent = UNKNOWN_EXPONENT
        size, seconds = so_far[-1]
        return seconds * (n / size) ** exponent


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
