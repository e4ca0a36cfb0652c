"""Statistics over problems or pairs: means with intervals, paired tests, and rankings of methods.

Intervals are percentiles of the means of `RESAMPLES` draws of the units with replacement (Efron 1979). They
say nothing of problems of another kind, and take the units as independent. Differences from the best method
are tested on the same units: scores by Wilcoxon's signed-rank test, yes or no by McNemar's exact test. The p
of all comparisons of a column are adjusted by Holm (1979). A method that failed on a problem, or was given up
there, has F 0 there and hasn't registered it.

A unit is a problem, or in `rank_overall` a pair: it counts once, with the mean of its cases, which are its
levels of nuisances, detectors and descriptors. Pairs named `object/pair` of one object share scans, so that
an object is one unit, where a data set has at least `LEAST_OBJECTS` of them. Every draw has as many units of
each data set as there are.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy import stats

from cgroup.benchmark.problem import keyed_rng
from cgroup.datasets.generated_matches import GeneratedMatches
from cgroup.evaluation.paired_tests import holm, mcnemar

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence
    from typing import TypeAlias

    import pandas as pd
    from numpy.typing import ArrayLike

    from cgroup.types import BoolArray, FloatArray, IndexArray

    Test: TypeAlias = Callable[[ArrayLike, ArrayLike], float]

__all__ = [
    "GENERATED",
    "LEAST_OBJECTS",
    "LEVEL",
    "REAL",
    "RESAMPLES",
    "Interval",
    "Overall",
    "Rank",
    "Standing",
    "bootstrap",
    "rank_methods",
    "rank_overall",
]

RESAMPLES = 10_000
"""Draws of the bootstrap."""

LEVEL = 0.95
"""Of the intervals; a difference is significant if its p is below 1 - `LEVEL`."""

LEAST_OBJECTS = 5
"""Objects that a data set must have for them to be drawn in place of its pairs."""

REAL = "real and semi-synthetic"
"""Pairs of real shapes, scanned or with a part that is simulated."""

GENERATED = "synthetic"
"""Pairs of generated shapes; the two kinds are ranked apart."""


class Interval(NamedTuple):
    """A mean and the interval about it.

    Attributes
    ----------
    mean : float
        Over the units.
    low, high : float
        Ends of the interval that holds 95 % of the means of resampled units.

    Examples
    --------
    >>> from cgroup.benchmark.stats import bootstrap
    >>> bootstrap([[0.0], [1.0], [1.0], [1.0]])
    [Interval(mean=0.75, low=0.25, high=1.0)]
    """

    mean: float
    low: float
    high: float


class Standing(NamedTuple):
    """How a method does by one measure.

    Attributes
    ----------
    interval : Interval
        Mean over pairs.
    p : float
        Adjusted p of the difference from the method with the highest mean; 1 for that one.
    tied : bool
        Whether the method can't be told from that one.

    Examples
    --------
    >>> from cgroup.benchmark.stats import Interval, Standing
    >>> Standing(Interval(0.5, 0.4, 0.6), p=0.01, tied=False).interval.mean
    0.5
    """

    interval: Interval
    p: float
    tied: bool


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
    >>> from cgroup.benchmark.stats import Interval, Rank
    >>> rank = Rank("gtm", Interval(0.9, 0.8, 1), Interval(1, 1, 1), True, True, 1, 1)
    >>> rank.f_score.mean
    0.9
    """

    method: str
    f_score: Interval
    registered: Interval
    f_tied: bool
    registered_tied: bool
    p_f_score: float
    p_registered: float


@dataclass(frozen=True)
class Overall:
    """A ranking over all pairs of a kind.

    Attributes
    ----------
    kind : str
        `REAL` or `GENERATED`.
    methods : tuple of str
        The best by the first measure first.
    standings : dict of str to dict of str to Standing
        By measure and method.
    p_between : dict of (str, str) to float
        Adjusted p of the difference of two methods by the first measure, over all twos.
    pairs : dict of str to int
        Number of pairs by data set.
    cases, further_cases, units : int
        How many cases all ranked methods have, how many only some of them, and how many units are drawn.
    by_object : tuple of str
        Data sets whose objects are drawn.
    unranked : dict of str to int
        Methods that aren't ranked, with the number of their cases.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.stats import rank_overall
    >>> rows = pd.DataFrame(
    ...     {"pair": ["a", "b"] * 2, "method": ["gc"] * 2 + ["gtm"] * 2}
    ... )
    >>> rows = rows.assign(dataset="mine", case=rows["pair"], origin="real")
    >>> (overall,) = rank_overall(
    ...     rows.assign(f_score=[0.5, 0.6, 0.9, 0.8]), ["f_score"]
    ... )
    >>> overall.methods, overall.pairs, overall.cases
    (('gtm', 'gc'), {'mine': 2}, 2)
    """

    kind: str
    methods: tuple[str, ...]
    standings: dict[str, dict[str, Standing]]
    p_between: dict[tuple[str, str], float]
    pairs: dict[str, int]
    cases: int
    further_cases: int
    units: int
    by_object: tuple[str, ...]
    unranked: dict[str, int]


# --- Statistics ---------------------------------------------------------------------------------------------


def draw_weights(count: int, resamples: int, *key: object) -> FloatArray:
    """Draw as many units as there are, with replacement: how often each draw has each, (resamples,count)."""
    drawn = keyed_rng(*key).multinomial(count, np.full(count, 1 / count), size=resamples)
    return drawn.astype(np.float64)


def bootstrap(
    sums: ArrayLike, counts: FloatArray | None = None, *, strata: Sequence[Hashable] | None = None
) -> list[Interval]:
    """Find the mean and its interval for every column.

    Parameters
    ----------
    sums : (n,m) array_like of float
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
    >>> from cgroup.benchmark.stats import bootstrap
    >>> first, second = bootstrap([[0.2, 1.0], [0.4, 1.0], [0.6, 1.0]])
    >>> round(first.mean, 2), second
    (0.4, Interval(mean=1.0, low=1.0, high=1.0))
    """
    values = np.asarray(sums, dtype=np.float64)
    numbers = np.ones_like(values) if counts is None else counts
    labels = np.zeros(len(values), dtype=np.intp)
    if strata is not None:
        known = list(dict.fromkeys(strata))
        labels = np.array([known.index(label) for label in strata], dtype=np.intp)
    totals = np.zeros(values.shape[1])
    draws = np.zeros((RESAMPLES, values.shape[1]))
    with np.errstate(invalid="ignore"):  # draws without a value of a column
        for label in range(labels.max(initial=-1) + 1):
            chosen, of_values = values[labels == label], numbers[labels == label]
            weights = _draw_stratum(len(chosen), values.shape[1], label)
            share = of_values.sum(axis=0) / numbers.sum(axis=0)
            there = share > 0
            means = (weights @ chosen[:, there]) / (weights @ of_values[:, there])
            draws[:, there] += share[there] * means
            totals[there] += chosen[:, there].sum(axis=0)
        means = totals / numbers.sum(axis=0)
    return [
        Interval(float(mean), *_percentiles(column)) if known else Interval(*[float("nan")] * 3)
        for mean, column, known in zip(means, draws.T, numbers.sum(axis=0) > 0, strict=True)
    ]


@lru_cache(maxsize=4)
def _draw_stratum(count: int, columns: int, label: int) -> FloatArray:
    """Draw the units of a stratum; the random numbers are those of the size."""
    return draw_weights(count, RESAMPLES, "bootstrap", count, columns, *([label] if label else []))


def _percentiles(draws: FloatArray) -> tuple[float, float]:
    outside = (1 - LEVEL) / 2
    low, high = np.quantile(draws[~np.isnan(draws)], (outside, 1 - outside))
    return float(low), float(high)


def signed_rank(one: ArrayLike, other: ArrayLike) -> float:
    """Return the p of Wilcoxon's signed-rank test on paired values."""
    difference = np.asarray(one, dtype=float) - np.asarray(other, dtype=float)
    if not difference.any():
        return 1.0
    found: Any = stats.wilcoxon(difference, zero_method="pratt", method="asymptotic")
    return float(found.pvalue)


def _compare_with_best(values: FloatArray | BoolArray, test: Test, best: int | None = None) -> list[float]:
    """P of each column's difference from the best, or from a given one, adjusted by Holm; 1 for that one."""
    first = int(np.argmax(values.mean(axis=0))) if best is None else best
    others = [i for i in range(values.shape[1]) if i != first]
    found = dict(zip(others, holm([test(values[:, first], values[:, i]) for i in others]), strict=True))
    return [found.get(i, 1.0) for i in range(values.shape[1])]


# --- Methods on one set of problems -------------------------------------------------------------------------


def rank_methods(trials: pd.DataFrame) -> list[Rank]:
    """Rank the methods of one set by F.

    Parameters
    ----------
    trials : DataFrame
        Rows of `load(path, "matches")` of one set and one number of threads; problems without a right answer
        and methods that no problem had the fields for are left out, and so is what not all methods have.

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
    >>> from cgroup.benchmark.stats import rank_methods
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
    f_scores, rights = scores.to_numpy(float), registered.to_numpy(bool)
    columns = zip(
        scores.columns,
        bootstrap(f_scores),
        bootstrap(rights),
        _compare_with_best(f_scores, signed_rank),
        _compare_with_best(rights, mcnemar),
        strict=True,
    )
    alpha = 1 - LEVEL
    ranks = [Rank(name, f, right, f_p >= alpha, p >= alpha, f_p, p) for name, f, right, f_p, p in columns]
    return sorted(ranks, key=lambda rank: -rank.f_score.mean)


def comparable(trials: pd.DataFrame) -> pd.DataFrame:
    """Keep the problems that have an answer, and methods that could be run on one.

    A pair without a single right match stays: its matches are what the front end left of it, and no
    method registers it.
    """
    related = trials[trials["kind"] == "related"]
    lacking = related["skipped"].str.startswith("needs ")
    return related[~related["method"].isin(set(related["method"]) - set(related.loc[~lacking, "method"]))]


def _by_problem(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    """One row per problem and one column per method, in their order; problems that all methods have."""
    table = rows.pivot_table(index="case", columns="method", values=column, aggfunc="first", sort=False)
    return table.dropna().reindex(columns=list(dict.fromkeys(rows["method"])))


# --- Methods over all pairs ---------------------------------------------------------------------------------


def rank_overall(rows: pd.DataFrame, measures: Sequence[str]) -> list[Overall]:
    """Rank what was run on the same pairs; synthetic ones stand apart.

    Only cases that all ranked methods were run on count, and methods that were run on fewer than half as many
    cases as others aren't ranked.

    Parameters
    ----------
    rows : DataFrame
        `dataset, pair, origin, case, method` and the measures, one row per case and method.
    measures : sequence of str
        Columns of numbers or flags, of which more is better; the first one ranks.

    Returns
    -------
    list of Overall
        At most one per kind, without those that have fewer than two methods.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.stats import rank_overall
    >>> rows = pd.DataFrame(
    ...     {"pair": ["a", "b"] * 2, "method": ["gc"] * 2 + ["gtm"] * 2}
    ... )
    >>> rows = rows.assign(dataset="mine", case=rows["pair"], origin="real")
    >>> (overall,) = rank_overall(
    ...     rows.assign(f_score=[0.5, 0.6, 0.9, 0.8]), ["f_score"]
    ... )
    >>> round(overall.standings["f_score"]["gc"].interval.mean, 2)
    0.55
    """
    if rows.empty:
        return []
    generated = rows["origin"] == "synthetic"
    kinds = ((REAL, rows[~generated]), (GENERATED, rows[generated]))
    ranked = (_rank_kind(kind, chosen, tuple(measures)) for kind, chosen in kinds if len(chosen))
    return [overall for overall in ranked if overall is not None]


def name_units(pairs: pd.DataFrame) -> list[str]:
    """Name what is drawn with replacement for each pair: its object, or itself."""
    objects = [
        f"{dataset}:{pair.rpartition('/')[0]}" if "/" in pair and dataset != GeneratedMatches.name else ""
        for dataset, pair in zip(pairs["dataset"], pairs["pair"], strict=True)
    ]
    known: dict[str, set[str]] = {}
    for dataset, name in zip(pairs["dataset"], objects, strict=True):
        known.setdefault(dataset, set()).add(name)
    return [
        name if name and len(known[dataset] - {""}) >= LEAST_OBJECTS else f"{dataset}:{pair}"
        for dataset, pair, name in zip(pairs["dataset"], pairs["pair"], objects, strict=True)
    ]


def _rank_kind(kind: str, rows: pd.DataFrame, measures: tuple[str, ...]) -> Overall | None:
    counts = rows.groupby("method", sort=False)["case"].nunique()
    ranked = list(counts.index[2 * counts >= counts.max()])
    tables = [_by_case(rows, measure)[ranked].dropna() for measure in measures]
    shared = tables[0].index
    if len(ranked) < 2 or shared.empty:
        return None
    by_pair = [table.loc[shared].groupby(level=["dataset", "pair"], sort=False).mean() for table in tables]
    pairs = by_pair[0].index.to_frame(index=False)
    names = name_units(pairs)
    units = list(dict.fromkeys(names))
    of_unit = np.array([units.index(name) for name in names], dtype=np.intp)
    datasets = [name.partition(":")[0] for name in units]
    standings = {
        measure: _find_standings(table.to_numpy(np.float64), of_unit, datasets, ranked)
        for measure, table in zip(measures, by_pair, strict=True)
    }
    first = standings[measures[0]]
    order = sorted(ranked, key=lambda method: -first[method].interval.mean)
    single = set(map(":".join, zip(pairs["dataset"], pairs["pair"], strict=True)))
    return Overall(
        kind,
        tuple(order),
        standings,
        _compare_all(_unit_means(by_pair[0].to_numpy(np.float64), of_unit), ranked),
        {str(name): int(count) for name, count in pairs.groupby("dataset", sort=False).size().items()},
        len(shared),
        rows.loc[rows["method"].isin(ranked), "case"].nunique() - len(shared),
        len(units),
        tuple(dict.fromkeys(d for d, unit in zip(datasets, units, strict=True) if unit not in single)),
        {str(method): int(count) for method, count in counts.items() if method not in ranked},
    )


def _by_case(rows: pd.DataFrame, measure: str) -> pd.DataFrame:
    """One row per case, one column per method; 0 where it failed, NaN where it wasn't run."""
    filled = rows.assign(value=rows[measure].astype(float).fillna(0.0))
    return filled.pivot_table(
        index=["dataset", "pair", "case"], columns="method", values="value", aggfunc="first", sort=False
    )


def _find_standings(
    values: FloatArray, of_unit: IndexArray, datasets: list[str], methods: list[str]
) -> dict[str, Standing]:
    by_unit = _unit_means(values, of_unit)
    numbers = np.repeat(np.bincount(of_unit).astype(np.float64)[:, None], values.shape[1], axis=1)
    means = bootstrap(by_unit * numbers, numbers, strata=datasets)
    best = int(np.argmax([mean.mean for mean in means]))
    yes_or_no = bool(np.isin(by_unit, (0.0, 1.0)).all())
    p = _compare_with_best(by_unit, mcnemar if yes_or_no else signed_rank, best)
    return {
        method: Standing(mean, each, each >= 1 - LEVEL)
        for method, mean, each in zip(methods, means, p, strict=True)
    }


def _unit_means(values: FloatArray, of_unit: IndexArray) -> FloatArray:
    sums = np.zeros((of_unit.max() + 1, values.shape[1]))
    np.add.at(sums, of_unit, values)
    return sums / np.bincount(of_unit)[:, None]


def _compare_all(values: FloatArray, methods: list[str]) -> dict[tuple[str, str], float]:
    """P of the difference of any two columns, adjusted together, in both orders."""
    twos = list(itertools.combinations(range(len(methods)), 2))
    p = holm([signed_rank(values[:, one], values[:, other]) for one, other in twos])
    found: dict[tuple[str, str], float] = {}
    for (one, other), each in zip(twos, p, strict=True):
        found[methods[one], methods[other]] = found[methods[other], methods[one]] = each
    return found
