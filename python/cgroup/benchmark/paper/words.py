"""Words for numbers, levels and methods, and two rank correlations."""

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pandas as pd
from scipy import stats

from cgroup.benchmark.paper.evidence import Level

_LEVELS = {  # of an experiment: one level, and all of them
    "noise": ("noise {} pr", "level of noise"),
    "density": ("{} kept", "share of the points kept"),
    "epsilon": ("ε {} pr", "threshold"),
    "matches": ("n {}", "number of matches"),
    "combinations": ("{}", "combination"),
}


def correlate_with_levels(at: Iterable[float], values: Iterable[float]) -> float:
    """Return Spearman's rank correlation of values with levels: 0 if constant, NaN under three levels."""
    x, y = np.fromiter(at, dtype=np.float64), np.fromiter(values, dtype=np.float64)
    known = ~np.isnan(y)
    if known.sum() < 3:
        return math.nan
    if np.ptp(y[known]) == 0:
        return 0.0
    found: Any = stats.spearmanr(x[known], y[known])
    return float(found.statistic)


def compare_rankings(one: pd.Series, other: pd.Series) -> float:
    """Return Kendall's tau-b of two rankings of the methods; 1 where all methods tie in both."""
    if all((scores == scores.iloc[0]).all() for scores in (one, other)):
        return 1.0
    found: Any = stats.kendalltau(one, other)
    return 0.0 if math.isnan(found.statistic) else float(found.statistic)


def show_score(value: float) -> str:
    """Write a score."""
    return f"{value:.3f}" if abs(value) < 0.1 else f"{value:.2f}"


def show_time(log_seconds: float) -> str:
    """Write a time that is given by its logarithm."""
    seconds = math.exp(log_seconds)
    return f"{seconds:.3g} s" if seconds >= 1 else f"{1e3 * seconds:.3g} ms"


def name_level(experiment: str, level: Level) -> str:
    """Name a level of an experiment."""
    text = level if isinstance(level, str) else f"{level:g}"
    return _LEVELS.get(experiment, (experiment + " {}", ""))[0].format(text)


def name(method: str) -> str:
    """Name a method as the paper does; other columns keep their name."""
    return method if " " in method else method.upper()


def join_names(methods: Iterable[str]) -> str:
    """List the names of methods."""
    return join(map(name, methods))


def join(names: Iterable[str]) -> str:
    """List names, each once."""
    known = list(dict.fromkeys(names))
    return " and ".join((", ".join(known[:-1]), known[-1])) if len(known) > 1 else "".join(known)


def noun_of_levels(experiment: str) -> str:
    """Return the noun for the levels of an experiment."""
    return _LEVELS.get(experiment, ("", f"level of {experiment}"))[1]
