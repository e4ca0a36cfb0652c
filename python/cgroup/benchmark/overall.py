"""How methods do over all pairs of all experiments: means over pairs with intervals, and paired tests.

A pair counts once, with the mean of its cases, which are its levels of nuisances, detectors and descriptors.
Only cases that all ranked methods were run on count, and methods that were run on fewer than half as many
cases as others aren't ranked. What failed has F 0 there, and hasn't registered the pair.

What is drawn for the intervals, and what the tests compare, is a pair; or the pairs of an object or room
together, as they have scans in common: `object/pair` is how such pairs are named. Data sets with fewer than
`LEAST_OBJECTS` of them are too small for that, and have their pairs drawn. Every draw has as many of each
data set as there are.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup.benchmark.rankings import (
    LEVEL,
    Interval,
    bootstrap,
    compare_with_best,
    holm,
    mcnemar,
    signed_rank,
)
from cgroup.datasets.generated_matches import GeneratedMatches

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

    from cgroup.types import FloatArray

__all__ = ["GENERATED", "LEAST_OBJECTS", "REAL", "Overall", "Standing", "name_units", "rank_overall"]

LEAST_OBJECTS = 5
"""How many objects a data set must have for them to be drawn in place of its pairs."""

REAL = "real and semi-synthetic"
"""Pairs of real shapes, scanned or with a part that is simulated."""

GENERATED = "synthetic"
"""Pairs of generated shapes; the two kinds are ranked apart."""


class Standing(NamedTuple):
    """How a method does by one measure.

    Attributes
    ----------
    interval : Interval
        Mean over pairs.
    p : float
        Adjusted p of the difference from the method with the highest mean; 1 for that one.
    tied : bool
        Whether it can't be told from that one.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.overall import rank_overall
    >>> pairs = [f"pair{k}" for k in range(5)]
    >>> rows = pd.DataFrame(
    ...     {"dataset": "mine", "pair": pairs * 2, "case": pairs * 2, "origin": "real"}
    ... )
    >>> rows["method"] = ["gc"] * 5 + ["gtm"] * 5
    >>> rows["f_score"] = [0.5, 0.6, 0.7, 0.6, 0.5, 0.9, 0.8, 0.9, 0.7, 0.9]
    >>> (overall,) = rank_overall(rows, ["f_score"])
    >>> standing = overall.standings["f_score"]["gtm"]
    >>> standing.p, standing.tied
    (1.0, True)
    """

    interval: Interval
    p: float
    tied: bool


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
    >>> from cgroup.benchmark.overall import rank_overall
    >>> pairs = [f"pair{k}" for k in range(5)]
    >>> rows = pd.DataFrame(
    ...     {"dataset": "mine", "pair": pairs * 2, "case": pairs * 2, "origin": "real"}
    ... )
    >>> rows["method"] = ["gc"] * 5 + ["gtm"] * 5
    >>> rows["f_score"] = [0.5, 0.6, 0.7, 0.6, 0.5, 0.9, 0.8, 0.9, 0.7, 0.9]
    >>> (overall,) = rank_overall(rows, ["f_score"])
    >>> overall.methods, overall.pairs, overall.cases
    (('gtm', 'gc'), {'mine': 5}, 5)
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


def rank_overall(rows: pd.DataFrame, measures: Sequence[str]) -> list[Overall]:
    """Rank what was run on the same pairs; synthetic ones stand apart.

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
    >>> from cgroup.benchmark.overall import rank_overall
    >>> pairs = [f"pair{k}" for k in range(5)]
    >>> rows = pd.DataFrame(
    ...     {"dataset": "mine", "pair": pairs * 2, "case": pairs * 2, "origin": "real"}
    ... )
    >>> rows["method"] = ["gc"] * 5 + ["gtm"] * 5
    >>> rows["f_score"] = [0.5, 0.6, 0.7, 0.6, 0.5, 0.9, 0.8, 0.9, 0.7, 0.9]
    >>> (overall,) = rank_overall(rows, ["f_score"])
    >>> round(overall.standings["f_score"]["gc"].interval.mean, 2)
    0.58
    """
    if rows.empty:
        return []
    generated = rows["origin"] == "synthetic"
    kinds = ((REAL, rows[~generated]), (GENERATED, rows[generated]))
    ranked = (_rank_kind(kind, chosen, tuple(measures)) for kind, chosen in kinds if len(chosen))
    return [overall for overall in ranked if overall is not None]


def name_units(pairs: pd.DataFrame) -> list[str]:
    """Name what is drawn with replacement for each pair: its object, or itself.

    Parameters
    ----------
    pairs : DataFrame
        `dataset, pair`, one row per pair.

    Returns
    -------
    list of str
        One name per row; rows of the same name are drawn together.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.overall import name_units
    >>> pairs = [f"room{k}/{i}" for k in range(5) for i in range(2)]
    >>> name_units(pd.DataFrame({"dataset": "rooms", "pair": pairs}))[:3]
    ['rooms:room0', 'rooms:room0', 'rooms:room1']
    """
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
    values: FloatArray, of_unit: np.ndarray, datasets: list[str], methods: list[str]
) -> dict[str, Standing]:
    counts = np.bincount(of_unit).astype(np.float64)
    by_unit = _unit_means(values, of_unit)
    numbers = np.repeat(counts[:, None], values.shape[1], axis=1)
    means = bootstrap(by_unit * numbers, numbers, strata=datasets)
    best = int(np.argmax([mean.mean for mean in means]))
    yes_or_no = bool(np.isin(by_unit, (0.0, 1.0)).all())
    p = compare_with_best(by_unit, mcnemar if yes_or_no else signed_rank, best)
    return {
        method: Standing(mean, each, each >= 1 - LEVEL)
        for method, mean, each in zip(methods, means, p, strict=True)
    }


def _unit_means(values: FloatArray, of_unit: np.ndarray) -> FloatArray:
    sums = np.zeros((of_unit.max() + 1, values.shape[1]))
    np.add.at(sums, of_unit, values)
    return sums / np.bincount(of_unit)[:, None]


def _compare_all(values: FloatArray, methods: list[str]) -> dict[tuple[str, str], float]:
    twos = list(itertools.combinations(range(len(methods)), 2))
    p = holm([signed_rank(values[:, one], values[:, other]) for one, other in twos])
    found: dict[tuple[str, str], float] = {}
    for (one, other), each in zip(twos, p, strict=True):
        found[methods[one], methods[other]] = found[methods[other], methods[one]] = each
    return found
