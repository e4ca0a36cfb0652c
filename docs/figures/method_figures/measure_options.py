"""Measure precision, recall, F and time for every value of `SWEEPS`."""

from __future__ import annotations

import statistics
import time
from typing import TYPE_CHECKING

import numpy as np

import cgroup
from cgroup.evaluation import score_group
from method_figures.measured import load_options
from method_figures.sweeps import SWEEPS, VIEWS, Sweep, problems

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

COLUMNS = ("method", "option", "value", "data", "precision", "recall", "f_score", "milliseconds")


def measure_sweep(sweep: Sweep) -> Iterator[tuple[str, ...]]:
    """Yield one row per value and kind of data: means over the problems, the median of the time."""
    for data in sweep.data:
        for value in sweep.levels:
            yield (sweep.method, sweep.option, str(value), data, *measure_value(sweep, value, data))


def measure_value(sweep: Sweep, value: object, data: str) -> tuple[str, ...]:
    """Return precision, recall and F, means over the problems, and the median of the milliseconds."""
    scores, times = zip(*(_try(sweep, value, data, i) for i in range(len(problems(data)))), strict=True)
    means = np.mean(scores, axis=0)
    return (*(f"{mean:.4f}" for mean in means), f"{statistics.median(times):.3f}")


def measure_all() -> Iterator[tuple[str, ...]]:
    """Yield the rows of all sweeps."""
    for sweep in SWEEPS:
        yield from measure_sweep(sweep)


def list_changed(methods: Iterable[str]) -> list[str]:
    """Measure one value per method again; return a line for each that differs by more than 1e-4."""
    table = load_options().set_index(["method", "option", "value", "data"])
    lines: list[str] = []
    for method in methods:
        sweep = next(sweep for sweep in SWEEPS if sweep.method == method)
        data, value = next(kind for kind in sweep.data if kind != VIEWS), sweep.levels[-1]
        row = table.loc[(method, sweep.option, str(value), data)]
        before = row[["precision", "recall", "f_score"]].to_numpy(dtype=float)
        today = np.array([float(text) for text in measure_value(sweep, value, data)[:3]])
        if np.abs(today - before).max() > 1e-4:
            lines.append(f"{method}, {sweep.option}={value}: {before} was measured, {today} is today's")
    return lines


def _try(sweep: Sweep, value: object, data: str, number: int) -> tuple[tuple[float, float, float], float]:
    """Return precision, recall and F of one call, and its milliseconds on one thread."""
    matches, correct = problems(data)[number]
    given = sweep.given(str(value), matches) if sweep.fields else matches
    options = sweep.options(value, float(matches.resolution or 1.0))
    taken = []
    for _ in range(2):
        start = time.perf_counter()
        mask = cgroup.group(given, sweep.method, threads=1, **options).mask
        taken.append(1000 * (time.perf_counter() - start))
    score = score_group(mask, correct)
    return (score.precision, score.recall, score.f_score), min(taken)
