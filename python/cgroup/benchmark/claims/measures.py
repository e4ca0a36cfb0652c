"""The few comparisons that claims are made of."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from cgroup.benchmark.claims.base import TIE, Comparison, NotTestableError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    import pandas as pd

    from cgroup.benchmark.sample import Level, Sample

COMBINATIONS = ("C1", "C2", "C3", "C4", "C5", "C6")
"""Of detector and descriptor, as the paper numbers them."""

_NAMES = {
    "combinations": "{}",
    "noise": "noise {} pr",
    "density": "{} kept",
    "epsilon": "ε {} pr",
    "matches": "n {}",
}


def name_level(sample: Sample, level: Level) -> str:
    """Name a level of an experiment."""
    text = level if isinstance(level, str) else f"{level:g}"
    return _NAMES.get(sample.experiment.id, sample.experiment.id + " {}").format(text)


def show_score(value: float) -> str:
    """Write a score."""
    return f"{value:.3f}" if abs(value) < 0.1 else f"{value:.2f}"


def show_time(log_seconds: float) -> str:
    """Write a time that is given by its logarithm."""
    seconds = math.exp(log_seconds)
    return f"{seconds:.3g} s" if seconds >= 1 else f"{1e3 * seconds:.3g} ms"


def show_order(rates: pd.Series) -> str:
    """Write registration rates, best first."""
    ordered = rates.sort_values(ascending=False, kind="stable").items()
    return "Rates: " + ", ".join(f"{method.upper()} {show_score(rate)}" for method, rate in ordered) + "."


def expect_above(label: str, value: float, bound: float) -> Comparison:
    """Value > bound."""
    return Comparison(value > bound, f"{label} {show_score(value)}", value - bound)


def expect_at_least(label: str, value: float, bound: float) -> Comparison:
    """Value >= bound, up to rounding."""
    return Comparison(value >= bound - 1e-12, f"{label} {show_score(value)}", value - bound)


def expect_at_most(label: str, value: float, bound: float) -> Comparison:
    """Value <= bound, up to rounding."""
    return Comparison(value <= bound + 1e-12, f"{label} {show_score(value)}", bound - value)


def expect_below(label: str, value: float, bound: float) -> Comparison:
    """Value < bound."""
    return Comparison(value < bound, f"{label} {show_score(value)}", bound - value)


def expect_higher(
    scores: pd.Series,
    one: str,
    other: str,
    label: str,
    *,
    by: float = TIE,
    show: Callable[[float], str] = show_score,
) -> Comparison:
    """One method's score is higher than another's by more than `by`."""
    margin = float(scores[one] - scores[other] - by)
    text = f"{label} {one.upper()} {show(scores[one])}, {other.upper()} {show(scores[other])}"
    return Comparison(margin > 0, text, margin)


def expect_in_top(
    scores: pd.Series,
    method: str,
    k: int,
    label: str,
    *,
    tie: float = TIE,
    show: Callable[[float], str] = show_score,
) -> Comparison:
    """Fewer than k others have a score that is higher by more than a tie."""
    values = scores.to_numpy(dtype=np.float64)
    is_rival = (scores.index != method) & ~np.isnan(values)
    if is_rival.sum() < k:
        message = f"fewer than {k + 1} methods to rank"
        raise NotTestableError(message)
    at = np.flatnonzero(is_rival)[np.argsort(-values[is_rival], kind="stable")[k - 1]]
    rival, value = scores.index[at], float(values[at])
    margin = float(scores[method]) - value
    nth = {1: "best other", 2: "second of the others", 3: "third of the others"}.get(
        k, f"number {k} of the others"
    )
    text = f"{label} {method.upper()} {show(float(scores[method]))}, {nth} {str(rival).upper()} {show(value)}"
    return Comparison(margin >= -tie, text, margin)


def expect_in_top_at_levels(
    sample: Sample, table: pd.DataFrame, what: str, tops: Mapping[str, int]
) -> list[Comparison]:
    """Each of some methods among the top k at each level of a table; `tops` holds k by method."""
    return [
        expect_in_top(row, method, k, f"{name_level(sample, level)}, {what}:")
        for level, row in table.iterrows()
        for method, k in tops.items()
    ]


def rank(scores: pd.Series, method: str) -> int:
    """1 + number of methods that are better by more than a tie."""
    return 1 + int((scores > scores[method] + TIE).sum())


def measure_lead(scores: pd.Series, methods: Iterable[str]) -> float:
    """Mean of some methods, above the best of the others."""
    named = scores.index.isin(list(methods))
    return float(scores[named].mean() - scores[~named].max())


def correlate_with_levels(levels: Iterable[float], values: Iterable[float]) -> float:
    """Spearman's rank correlation of values with levels; 0 for constant values, NaN under three levels."""
    x, y = np.fromiter(levels, dtype=np.float64), np.fromiter(values, dtype=np.float64)
    known = ~np.isnan(y)
    if known.sum() < 3:
        return math.nan
    if np.ptp(y[known]) == 0:
        return 0.0
    return float(stats.spearmanr(x[known], y[known]).statistic)


def compare_rankings(one: pd.Series, other: pd.Series) -> float:
    """Kendall's tau-b between two rankings of the methods; 1 where both are ties throughout."""
    orders = [np.sign(np.subtract.outer(scores, scores)) for scores in (one.to_numpy(), other.to_numpy())]
    ordered = [float((order**2).sum()) for order in orders]
    if ordered == [0.0, 0.0]:
        return 1.0
    norm = math.sqrt(ordered[0] * ordered[1])
    tau = float((orders[0] * orders[1]).sum()) / norm if norm else 0.0
    return 0.0 if math.isnan(tau) else tau


def find_ends(table: pd.DataFrame) -> tuple[Level, Level]:
    """Lowest and highest level; there have to be two."""
    if len(table) < 2:
        message = "the records hold one level only"
        raise NotTestableError(message)
    return table.index[0], table.index[-1]


def pick_levels(table: pd.DataFrame, wanted: Callable[[float], bool], what: str) -> pd.DataFrame:
    """Rows of the levels that a statement is about; there has to be one."""
    chosen = table[[wanted(round(level, 6)) for level in table.index]]
    if chosen.empty:
        message = f"the records hold no level {what}"
        raise NotTestableError(message)
    return chosen


def need_levels(table: pd.DataFrame, levels: Iterable[Level]) -> pd.DataFrame:
    """Rows of levels that a statement names; all have to be there."""
    named = list(levels)
    missing = [each for each in named if each not in table.index]
    if missing:
        message = "the records lack the level " + ", ".join(str(each) for each in missing)
        raise NotTestableError(message)
    return table.loc[named]


def list_cells(sample: Sample, table: pd.DataFrame, what: str) -> list[tuple[str, float]]:
    """Label and value for each level and method."""
    return [
        (f"{name_level(sample, level)}, {what} of {method.upper()}", float(value))
        for level, row in table.iterrows()
        for method, value in row.items()
    ]
