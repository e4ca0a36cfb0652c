"""Means with intervals, paired tests, and rankings of methods.

Intervals are percentiles of bootstrap means (Efron 1979). Differences from the best method are tested on the
same units by Wilcoxon's signed-rank test or McNemar's exact test, adjusted by Holm (1979) over a column. A
unit is a problem, or in `rank_overall` a pair with the mean of its cases. Pairs `object/pair` of one object
share scans: the object is the unit if a data set has at least `LEAST_OBJECTS`.
"""

from collections.abc import Callable, Hashable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy import stats

from cgroup.benchmark.problem import keyed_rng
from cgroup.datasets.generated_matches import GeneratedMatches
from cgroup.evaluation.recall_protocols import holm, mcnemar
from cgroup.types import BoolArray, FloatArray, IndexArray

Test: TypeAlias = Callable[[ArrayLike, ArrayLike], float]

__all__ = ["rank_methods"]

RESAMPLES = 10_000  # draws of the bootstrap
LEVEL = 0.95  # level of the intervals; a difference is significant if its p is below 1 - `LEVEL`
ENDS = ((1 - LEVEL) / 2, 1 - (1 - LEVEL) / 2)  # quantiles at the ends of the intervals
LEAST_OBJECTS = 5  # least number of objects of a data set for drawing objects instead of pairs
REAL = "real and semi-synthetic"  # pairs of real shapes, scanned or with a part that is simulated
GENERATED = "synthetic"  # pairs of generated shapes; the two kinds are ranked apart


class Interval(NamedTuple):
    """A mean over units, and the ends of its interval."""

    mean: float
    low: float
    high: float


class Standing(NamedTuple):
    """A method by one measure; `p` is of its difference from the best, `tied` if that is not significant."""

    interval: Interval
    p: float
    tied: bool


class Rank(NamedTuple):
    """A method on a set of problems: mean F and share registered, ties with the best, and adjusted p."""

    method: str
    f_score: Interval
    registered: Interval
    f_tied: bool
    registered_tied: bool
    p_f_score: float
    p_registered: float


class Overall(NamedTuple):
    """A ranking over all pairs of a kind, `REAL` or `GENERATED`.

    `methods` are sorted by the first measure. `standings` are by measure and method. `pairs` counts pairs by
    data set, `cases` those that all ranked methods have, `further_cases` the others, `units` what is drawn.
    `unranked` has the numbers of cases of methods with too few.
    """

    kind: str
    methods: tuple[str, ...]
    standings: dict[str, dict[str, Standing]]
    pairs: dict[str, int]
    cases: int
    further_cases: int
    units: int
    unranked: dict[str, int]


def bootstrap(
    sums: ArrayLike, counts: FloatArray | None = None, *, strata: Sequence[Hashable] | None = None
) -> list[Interval]:
    """Return the mean of every column with its interval; NaN for a column without values.

    Rows are units, which are drawn alike for all columns; each has the sums of its values, or its only value.
    `counts` are the numbers of values in the sums, 1 by default. `strata` are the data sets of the units:
    every draw has the original number of units per data set, and data sets keep their weights in the mean.
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
        Interval(float(mean), *map(float, np.quantile(column[~np.isnan(column)], ENDS)))
        if known
        else Interval(*[float("nan")] * 3)
        for mean, column, known in zip(means, draws.T, numbers.sum(axis=0) > 0, strict=True)
    ]


@lru_cache(maxsize=4)
def _draw_stratum(count: int, columns: int, label: int) -> FloatArray:
    """Return the count of each unit of a stratum in each draw with replacement, (RESAMPLES,count)."""
    rng = keyed_rng("bootstrap", count, columns, *([label] if label else []))
    return rng.multinomial(count, np.full(count, 1 / count), size=RESAMPLES).astype(np.float64)


def signed_rank(one: ArrayLike, other: ArrayLike) -> float:
    """Return the p of Wilcoxon's signed-rank test on paired values."""
    difference = np.asarray(one, dtype=float) - np.asarray(other, dtype=float)
    if not difference.any():
        return 1.0
    found: Any = stats.wilcoxon(difference, zero_method="pratt", method="asymptotic")
    return float(found.pvalue)


def _compare_with_best(values: FloatArray | BoolArray, test: Test, best: int | None = None) -> list[float]:
    """Return the adjusted p of each column's difference from a reference, by default the best; 1 for it."""
    first = int(np.argmax(values.mean(axis=0))) if best is None else best
    others = [i for i in range(values.shape[1]) if i != first]
    found = dict(zip(others, holm([test(values[:, first], values[:, i]) for i in others]), strict=True))
    return [found.get(i, 1.0) for i in range(values.shape[1])]


def rank_methods(trials: pd.DataFrame) -> list[Rank]:
    """Rank the methods of one set by F.

    Parameters
    ----------
    trials : DataFrame
        Rows of `load(path, "matches")` of one set and one number of threads. Problems without a correct pose,
        problems that not all methods have, and methods whose fields all problems lack are left out.

    Returns
    -------
    list of Rank
        The best first; ties in the order of the rows. Empty without problems. Each has `method`, intervals
        `f_score` and `registered` (`mean, low, high`), and for both whether the difference from the best is
        not significant (`f_tied, registered_tied`) and its p (`p_f_score, p_registered`; 1 for the best).

    Raises
    ------
    KeyError
        For trials without a required column.

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
    """Return problems that have a correct pose, and methods that could be run on one.

    A pair without a correct match stays: the front end lost it, and no method registers it.
    """
    related = trials[trials["kind"] == "related"]
    lacking = related["skipped"].str.startswith("needs ")
    return related[~related["method"].isin(set(related["method"]) - set(related.loc[~lacking, "method"]))]


def _by_problem(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    table = rows.pivot_table(index="case", columns="method", values=column, aggfunc="first", sort=False)
    return table.dropna().reindex(columns=list(dict.fromkeys(rows["method"])))


def rank_overall(rows: pd.DataFrame, measures: Sequence[str]) -> list[Overall]:
    """Rank methods over all pairs, by the first of several measures; synthetic pairs are ranked apart.

    `rows` has one row per case and method with `dataset, pair, origin, case, method` and the measures, of
    which more is better. Only cases of all ranked methods count; a method with fewer than half as many cases
    as others isn't ranked, and a kind with fewer than two methods is left out.
    """
    if rows.empty:
        return []
    generated = rows["origin"] == "synthetic"
    kinds = ((REAL, rows[~generated]), (GENERATED, rows[generated]))
    ranked = (_rank_kind(kind, chosen, tuple(measures)) for kind, chosen in kinds if len(chosen))
    return [overall for overall in ranked if overall is not None]


def name_units(pairs: pd.DataFrame) -> list[str]:
    """Return the unit of each pair: its object, or itself."""
    objects = pairs["pair"].str.rpartition("/")[0].mask(pairs["dataset"] == GeneratedMatches.name, "")
    counts = objects[objects != ""].groupby(pairs["dataset"]).nunique()
    several = pairs["dataset"].map(counts).ge(LEAST_OBJECTS) & (objects != "")
    return (pairs["dataset"] + ":" + objects.where(several, pairs["pair"])).tolist()


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
    return Overall(
        kind,
        tuple(order),
        standings,
        {str(name): int(count) for name, count in pairs.groupby("dataset", sort=False).size().items()},
        len(shared),
        rows.loc[rows["method"].isin(ranked), "case"].nunique() - len(shared),
        len(units),
        {str(method): int(count) for method, count in counts.items() if method not in ranked},
    )


def _by_case(rows: pd.DataFrame, measure: str) -> pd.DataFrame:
    """Return one row per case, one column per method; 0 where it failed, NaN where it wasn't run."""
    filled = rows.assign(value=rows[measure].astype(float).fillna(0.0))
    return filled.pivot_table(
        index=["dataset", "pair", "case"], columns="method", values="value", aggfunc="first", sort=False
    )


def _find_standings(
    values: FloatArray, of_unit: IndexArray, datasets: list[str], methods: list[str]
) -> dict[str, Standing]:
    sizes = np.bincount(of_unit).astype(np.float64)[:, None]
    sums = np.zeros((len(sizes), values.shape[1]))
    np.add.at(sums, of_unit, values)
    by_unit, numbers = sums / sizes, np.repeat(sizes, values.shape[1], axis=1)
    means = bootstrap(by_unit * numbers, numbers, strata=datasets)
    best = int(np.argmax([mean.mean for mean in means]))
    yes_or_no = bool(np.isin(by_unit, (0.0, 1.0)).all())
    p = _compare_with_best(by_unit, mcnemar if yes_or_no else signed_rank, best)
    return {
        method: Standing(mean, each, each >= 1 - LEVEL)
        for method, mean, each in zip(methods, means, p, strict=True)
    }
