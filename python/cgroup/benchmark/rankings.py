"""How methods rank on a set of problems: means with intervals, and whether a difference could be chance.

Intervals are percentiles of the means of `RESAMPLES` draws of the problems with replacement (Efron 1979);
they say nothing of problems of another kind, and take the problems as independent. Differences from the best
method are tested on the same problems: F by Wilcoxon's signed-rank test, registration by McNemar's exact test
(whether, of the problems that only one of two registers, either has more than half); the p of all comparisons
of a column are adjusted by Holm (1979). A method that was given up on a problem, or failed there, has F 0
there and hasn't registered it.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import stats

from cgroup.benchmark.problem import keyed_rng

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence
    from typing import TypeAlias

    import pandas as pd
    from numpy.typing import ArrayLike

    from cgroup.types import BoolArray, FloatArray

    Test: TypeAlias = Callable[[ArrayLike, ArrayLike], float]

__all__ = [
    "LEVEL",
    "RESAMPLES",
    "Interval",
    "Rank",
    "bootstrap",
    "comparable",
    "holm",
    "mcnemar",
    "rank_methods",
    "signed_rank",
]

RESAMPLES = 10_000
"""Draws of the bootstrap."""

LEVEL = 0.95
"""Of the intervals; differences are significant below what it leaves."""


class Interval(NamedTuple):
    """A mean and the interval about it.

    Attributes
    ----------
    mean : float
        Over the problems.
    low, high : float
        Ends of the interval that holds 95 % of the means of resampled problems.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.benchmark.rankings import bootstrap
    >>> (interval,) = bootstrap(np.array([[0.0], [1.0], [1.0], [1.0]]))
    >>> interval
    Interval(mean=0.75, low=0.25, high=1.0)
    """

    mean: float
    low: float
    high: float


class Rank(NamedTuple):
    """How a method does on a set of problems.

    Attributes
    ----------
    method : str
        By its label.
    f_score, registered : Interval
        Mean F, and the share of registered problems.
    f_tied, registered_tied : bool
        Whether it can't be told from the first in F, or from the one that registers most.
    p_f_score, p_registered : float
        Adjusted p of the difference from those; 1 for these themselves.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.rankings import rank_methods
    >>> methods = ["gc"] * 3 + ["gtm"] * 3
    >>> trials = pd.DataFrame({"case": [1, 2, 3] * 2, "method": methods})
    >>> trials["f_score"] = [0.5, 0.6, 0.7, 0.9, 0.9, 0.8]
    >>> trials = trials.assign(right=True, kind="related", skipped="")
    >>> best, other = rank_methods(trials)
    >>> best.method, other.registered_tied
    ('gtm', True)
    """

    method: str
    f_score: Interval
    registered: Interval
    f_tied: bool
    registered_tied: bool
    p_f_score: float
    p_registered: float


def rank_methods(trials: pd.DataFrame) -> list[Rank]:
    """Rank the methods of one set by F.

    Parameters
    ----------
    trials : DataFrame
        Rows of `load_trials` of one set and one number of threads; problems without a right answer and
        methods that no problem had the fields for are left out, and so is what not all methods have.

    Returns
    -------
    list of Rank
        The best first; ties in the order of the rows. Empty without problems.

    Raises
    ------
    KeyError
        For trials that lack a column.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.rankings import rank_methods
    >>> methods = ["gc"] * 3 + ["gtm"] * 3
    >>> trials = pd.DataFrame({"case": [1, 2, 3] * 2, "method": methods})
    >>> trials["f_score"] = [0.5, 0.6, 0.7, 0.9, 0.9, 0.8]
    >>> trials = trials.assign(right=True, kind="related", skipped="")
    >>> [(rank.method, round(rank.f_score.mean, 2)) for rank in rank_methods(trials)]
    [('gtm', 0.87), ('gc', 0.6)]
    """
    rows = comparable(trials)
    scores, registered = _by_problem(rows, "f_score"), _by_problem(rows, "right")
    if scores.empty:
        return []
    names = list(scores.columns)
    f_scores, rights = scores.to_numpy(float), registered.to_numpy(bool)
    f_means, f_p = bootstrap(f_scores), compare_with_best(f_scores, signed_rank)
    shares, right_p = bootstrap(rights.astype(float)), compare_with_best(rights, mcnemar)
    alpha = 1 - LEVEL
    ranks = [
        Rank(names[i], f_means[i], shares[i], f_p[i] >= alpha, right_p[i] >= alpha, f_p[i], right_p[i])
        for i in range(len(names))
    ]
    return sorted(ranks, key=lambda rank: -rank.f_score.mean)


def comparable(trials: pd.DataFrame) -> pd.DataFrame:
    """Keep the problems that have an answer, and methods that could be run on one.

    A pair without a single right match stays: its matches are what the front end left of it, and no
    method registers it.

    Parameters
    ----------
    trials : DataFrame
        Rows of `cgroup.benchmark.tables.load`.

    Returns
    -------
    DataFrame
        Some of the rows.

    Raises
    ------
    KeyError
        For trials that lack a column.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.rankings import comparable
    >>> trials = pd.DataFrame(
    ...     {"method": ["ss", "gtm"], "skipped": ["needs similarity", ""]}
    ... )
    >>> list(comparable(trials.assign(kind="related"))["method"])
    ['gtm']
    """
    related = trials[trials["kind"] == "related"]
    lacking = related["skipped"].str.startswith("needs ")
    return related[~related["method"].isin(set(related["method"]) - set(related.loc[~lacking, "method"]))]


def bootstrap(
    sums: FloatArray, counts: FloatArray | None = None, *, strata: Sequence[Hashable] | None = None
) -> list[Interval]:
    """Find the mean and its interval for every column.

    Parameters
    ----------
    sums : (n,m) array of float
        One row per unit, which is what is drawn with replacement, alike for all columns: sums of its values,
        or its only value.
    counts : (n,m) array of float, optional
        How many values each sum is of; 1 by default.
    strata : sequence, optional
        Of which data set each unit is: every draw has as many units of each as there are, and the data sets
        keep their shares in the mean. All units are of one by default.

    Returns
    -------
    list of Interval
        One per column; NaN where it has no values.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.benchmark.rankings import bootstrap
    >>> first, second = bootstrap(np.array([[0.2, 1.0], [0.4, 1.0], [0.6, 1.0]]))
    >>> round(first.mean, 2), second
    (0.4, Interval(mean=1.0, low=1.0, high=1.0))
    """
    numbers = np.ones_like(sums) if counts is None else counts
    labels = np.zeros(len(sums), dtype=np.intp)
    if strata is not None:
        known = list(dict.fromkeys(strata))
        labels = np.array([known.index(label) for label in strata], dtype=np.intp)
    totals = np.zeros(sums.shape[1])
    draws = np.zeros((RESAMPLES, sums.shape[1]))
    with np.errstate(invalid="ignore"):  # draws without a value of a column
        for label in range(labels.max(initial=-1) + 1):
            chosen = labels == label
            values, of_values = sums[chosen], numbers[chosen]
            weights = _draw_weights(int(chosen.sum()), sums.shape[1], label)
            share = of_values.sum(axis=0) / numbers.sum(axis=0)
            there = share > 0
            means = (weights @ values[:, there]) / (weights @ of_values[:, there])
            draws[:, there] += share[there] * means
            totals[there] += values[:, there].sum(axis=0)
        means = totals / numbers.sum(axis=0)
    return [
        Interval(float(mean), *_percentiles(column)) if known else Interval(*[float("nan")] * 3)
        for mean, column, known in zip(means, draws.T, numbers.sum(axis=0) > 0, strict=True)
    ]


@lru_cache(maxsize=4)
def _draw_weights(count: int, columns: int, label: int) -> FloatArray:
    """How often each draw has each unit; the random numbers are those of the size."""
    rng = keyed_rng("bootstrap", count, columns, *([label] if label else []))
    return rng.multinomial(count, np.full(count, 1 / count), size=RESAMPLES).astype(np.float64)


def _percentiles(draws: FloatArray) -> tuple[float, float]:
    outside = (1 - LEVEL) / 2
    low, high = np.quantile(draws[~np.isnan(draws)], (outside, 1 - outside))
    return float(low), float(high)


def signed_rank(one: ArrayLike, other: ArrayLike) -> float:
    """Return the p of Wilcoxon's signed-rank test on paired values.

    Parameters
    ----------
    one, other : (n,) array_like of float
        Values on the same problems.

    Returns
    -------
    float
        Two-sided; 1 where all are equal.

    Raises
    ------
    ValueError
        For unlike numbers of values.

    Examples
    --------
    >>> from cgroup.benchmark.rankings import signed_rank
    >>> signed_rank([0.9, 0.8], [0.9, 0.8])
    1.0
    >>> one, other = [0.9, 0.8, 0.7, 0.9, 0.6, 0.8], [0.1, 0.3, 0.2, 0.4, 0.1, 0.2]
    >>> signed_rank(one, other) < 0.05
    True
    """
    difference = np.asarray(one, dtype=float) - np.asarray(other, dtype=float)
    if not difference.any():
        return 1.0
    return float(stats.wilcoxon(difference, zero_method="pratt", method="asymptotic").pvalue)


def mcnemar(one: ArrayLike, other: ArrayLike) -> float:
    """Return the p of McNemar's exact test on paired successes.

    Parameters
    ----------
    one, other : (n,) array_like of bool
        Whether each of two methods succeeded, on the same problems.

    Returns
    -------
    float
        Two-sided; 1 where they never differ.

    Raises
    ------
    ValueError
        For unlike numbers of values.

    Examples
    --------
    >>> from cgroup.benchmark.rankings import mcnemar
    >>> mcnemar([True] * 8, [True, True] + [False] * 6)
    0.03125
    """
    first, second = np.asarray(one, dtype=bool), np.asarray(other, dtype=bool)
    only_first, only_second = int((first & ~second).sum()), int((second & ~first).sum())
    if not only_first + only_second:
        return 1.0
    return float(stats.binomtest(only_first, only_first + only_second).pvalue)


def holm(p: Sequence[float]) -> list[float]:
    """Adjust the p of several tests, so that the chance of any false alarm keeps.

    After Holm, Scandinavian Journal of Statistics 1979.

    Parameters
    ----------
    p : sequence of float
        Of each test.

    Returns
    -------
    list of float
        In the same order; significant are those below the level.

    Examples
    --------
    >>> from cgroup.benchmark.rankings import holm
    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    adjusted = [0.0] * len(p)
    so_far = 0.0
    for rank, i in enumerate(sorted(range(len(p)), key=lambda i: p[i])):
        so_far = max(so_far, min(1.0, (len(p) - rank) * p[i]))
        adjusted[i] = so_far
    return adjusted


def compare_with_best(values: FloatArray | BoolArray, test: Test, best: int | None = None) -> list[float]:
    """Find the p of each column's difference from one, adjusted by Holm; 1 for that one.

    Parameters
    ----------
    values : (n,m) array
        Rows are paired.
    test : callable
        From two columns to p.
    best : int, optional
        The column that others are compared with; the one with the highest mean by default.

    Returns
    -------
    list of float
        One per column.
    """
    first = int(np.argmax(values.mean(axis=0))) if best is None else best
    others = [i for i in range(values.shape[1]) if i != first]
    found = dict(zip(others, holm([test(values[:, first], values[:, i]) for i in others]), strict=True))
    return [found.get(i, 1.0) for i in range(values.shape[1])]


def _by_problem(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    """One row per problem and one column per method, in their order; problems that all methods have."""
    table = rows.pivot_table(index="case", columns="method", values=column, aggfunc="first", sort=False)
    return table.dropna().reindex(columns=list(dict.fromkeys(rows["method"])))
