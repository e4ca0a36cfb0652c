"""The numbers that claims compare: rows of the table, and derived numbers.

`levels`, `overall`, `everywhere` and `times` read the table. The other functions derive numbers from
numbers: of each row, such as `lead`, or one row from all, such as `change`.
"""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from scipy import stats

from cgroup.benchmark.paper import EXPERIMENTS, LEVELS, QUANTITIES
from cgroup.benchmark.paper.evidence import Level
from cgroup.benchmark.paper.table import MATCHES, TIMING, NotTestableError, Pick, Source, Witness
from cgroup.types import FloatArray

TIE, TIME_TIE = 0.01, math.log(1.05)  # largest difference of a tie, of scores and of logarithms of times
_ONE_LEVEL = "the records hold one level only"


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
    return LEVELS.get(experiment, (experiment + " {}", ""))[0].format(text)


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
    return LEVELS.get(experiment, ("", f"level of {experiment}"))[1]


class Row(NamedTuple):
    """Numbers of the methods at a level, or as the label states."""

    label: str
    scores: pd.Series
    level: Level = ""


@dataclass(frozen=True)
class Numbers:
    """Rows of numbers; `find` returns them, given the table and the methods that must be in it."""

    what: str  # the quantity in words
    where: str  # the rows in words
    find: Callable[[Witness, tuple[str, ...]], list[Row]]
    whose: str = "each method"  # the columns in words
    show: Callable[[float], str] = show_score
    tie: float = TIE  # largest difference of a tie
    superlative: str = "best"  # word for the highest number


def levels(measure: str, *given: Source | Pick) -> Numbers:
    """Means over pairs: one row for each level of some experiments, or for each picked level."""
    sources = [each for each in given if isinstance(each, Source)]
    pick = next((each for each in given if isinstance(each, Pick)), None)

    def find(witness: Witness, methods: tuple[str, ...]) -> list[Row]:
        tables = [(each, witness.read_levels(each, measure, methods)) for each in sources]
        return [
            Row(name_level(source.experiment, level), table.loc[level], level)
            for source, table in tables
            for level in (pick.choose(list(table.index)) if pick else table.index)
        ]

    nouns = (noun_of_levels(each.experiment) for each in sources)
    picked = f" {pick.words}" if pick else ""
    where = f"at each {' and each '.join(nouns)}{picked} on {join(source.place for source in sources)}"
    whose = MATCHES if measure in {"inlier_ratio", "correct"} else "each method"
    return Numbers(QUANTITIES[measure], where, find, whose)


def overall(measure: str, *sources: Source) -> Numbers:
    """Means over all levels: one row for each source."""

    def find(witness: Witness, methods: tuple[str, ...]) -> list[Row]:
        return [
            Row(each.place or each.experiment, witness.read_overall(each, measure, methods))
            for each in sources
        ]

    where = f"over all levels of {join(f'{each.experiment} ({each.place})' for each in sources)}"
    show = "{:.0f}".format if measure == "selected" else show_score
    return Numbers(QUANTITIES.get(measure, measure), where, find, show=show)


def everywhere(measure: str, methods: Sequence[str], *needed: Source, without: str) -> Numbers:
    """One row for each level of all experiments but one; some sources must be there."""

    def find(witness: Witness, _: tuple[str, ...]) -> list[Row]:
        for source in needed:
            witness.find(source, tuple(methods))
        rows: list[Row] = []
        for experiment, place in witness.table.origins:
            if experiment in EXPERIMENTS and experiment != without:
                table = witness.table.levels[(experiment, place), measure].reindex(columns=list(methods))
                rows += [Row(f"{place}, {name_level(experiment, at)}", table.loc[at]) for at in table.index]
        return rows

    places = join(source.place for source in needed)
    where = f"at each level of each experiment but '{without}'; needs '{needed[0].experiment}' on {places}"
    return Numbers(QUANTITIES[measure], where, find)


def times(superlative: Literal["longest", "shortest"], *, largest: int | None = None) -> Numbers:
    """Logarithms of the mean times: one row for each n, or for the largest n, which must reach a size."""
    sign = 1.0 if superlative == "longest" else -1.0

    def find(witness: Witness, methods: tuple[str, ...]) -> list[Row]:
        logs = sign * np.log(witness.read_levels(Source(TIMING, ""), "seconds", methods))
        if largest is not None and logs.index[-1] < largest:
            raise NotTestableError(f"no times for n of {largest} or more")
        return [Row(f"n {n}", row) for n, row in (logs if largest is None else logs.tail(1)).iterrows()]

    where = {None: "at each n", 0: "at the largest n"}.get(largest, f"at the largest n, at least {largest}")
    return Numbers(
        "time",
        where,
        find,
        show=lambda value: show_time(sign * value),
        tie=TIME_TIE,
        superlative=superlative,
    )


def together(*several: Numbers) -> Numbers:
    """Join the rows of several numbers of one kind."""
    return replace(
        several[0],
        where=" and ".join(each.where for each in several),
        find=lambda witness, methods: [row for each in several for row in each.find(witness, methods)],
    )


def lead(methods: Sequence[str], numbers: Numbers, *, worst: bool = False) -> Numbers:
    """Difference between the mean of some methods, or the worst of them, and the best of the others."""

    def find_lead(scores: pd.Series) -> pd.Series:
        is_named = scores.index.isin(list(methods))
        ours = scores[is_named].min() if worst else scores[is_named].mean()
        return pd.Series({join_names(methods): ours - scores[~is_named].max()})

    which = "the lowest of " if worst else "the mean of " if len(methods) > 1 else ""
    whose = f"{which}{join_names(methods)} over the best other"
    return _of_each(numbers, f"lead in {numbers.what}", find_lead, whose)


def behind(method: str, numbers: Numbers) -> Numbers:
    """Difference between the next worst method and this one."""
    return _of_each(
        numbers,
        f"deficit in {numbers.what}",
        lambda scores: pd.Series({name(method): scores.drop(method).min() - scores[method]}),
        f"{name(method)} behind the next worst",
    )


def beside_median(numbers: Numbers) -> Numbers:
    """Difference from the median of the methods."""
    what = f"{numbers.what} minus the median of the methods,"
    return _of_each(numbers, what, lambda scores: scores - scores.median(), numbers.whose)


def distance(one: str, other: str, numbers: Numbers) -> Numbers:
    """Absolute difference of two methods."""
    both = join_names((one, other))
    what, methods = f"difference in {numbers.what}", (one, other)
    return _of_each(
        numbers, what, lambda scores: pd.Series({both: abs(scores[one] - scores[other])}), both, methods
    )


def rank(numbers: Numbers) -> Numbers:
    """Rank of each method: 1 + the number of methods that are better by more than a tie."""
    ranks = _of_each(
        numbers,
        f"rank by {numbers.what}",
        lambda scores: scores.map(lambda score: 1.0 + (scores > score + TIE).sum()),
        numbers.whose,
    )
    return replace(ranks, show="{:.0f}".format)


def change(numbers: Numbers, *, since: float | None = None, drop: bool = False) -> Numbers:
    """Change from the first row, or from the last one up to a level, to the last row; or the drop."""

    def combine(rows: list[Row]) -> tuple[str, pd.Series]:
        passed = [row for row in rows if since is not None and float(row.level) <= since]
        first, last = passed[-1] if passed else rows[0], rows[-1]
        if first is last:
            raise NotTestableError(_ONE_LEVEL)
        return f"{first.label} to {last.label}", (last.scores - first.scores) * (-1 if drop else 1)

    start = "" if since is None else f" from about {since:g} on"
    found = _over(numbers, f"{'drop' if drop else 'change'} of {numbers.what}{start}", combine, least=2)
    return replace(found, superlative="largest")


def mean_of(numbers: Numbers, *, skipna: bool = True) -> Numbers:
    """Mean over all rows; missing numbers are skipped, or make the mean missing."""

    def combine(rows: list[Row]) -> tuple[str, pd.Series]:
        table = pd.DataFrame([row.scores for row in rows])
        return f"mean from {rows[0].label} to {rows[-1].label}", table.mean(skipna=skipna)

    return _over(numbers, numbers.what, combine, mean=True)


def stability(numbers: Numbers, *, mean: bool = False) -> Numbers:
    """Kendall's τ between the rankings of neighbouring rows; or its mean over any two rows."""

    def find(witness: Witness, methods: tuple[str, ...]) -> list[Row]:
        rows = _need_rows(numbers.find(witness, methods), 2)
        pairs = list(itertools.combinations(rows, 2) if mean else itertools.pairwise(rows))
        taus = [compare_rankings(one.scores, other.scores) for one, other in pairs]
        if mean:
            return [Row("any two", pd.Series({"any two": sum(taus) / len(taus)}))]
        labels = [f"{one.label} and {other.label}" for one, other in pairs]
        return [Row(label, pd.Series({"neighbours": tau})) for label, tau in zip(labels, taus, strict=True)]

    what = f"{'mean ' if mean else ''}Kendall τ of the rankings by {numbers.what}"
    return Numbers(what, _over_each(numbers.where), find, "any two" if mean else "neighbours")


def count_orders(methods: Sequence[str], numbers: Numbers) -> Numbers:
    """Count the different orders of some methods."""

    def combine(rows: list[Row]) -> tuple[str, pd.Series]:
        orders = {tuple(row.scores[list(methods)].sort_values().index) for row in rows}
        return "all", pd.Series({join_names(methods): float(len(orders))})

    found = _over(numbers, f"orders by {numbers.what}", combine)
    return replace(found, whose=join_names(methods), show="{:.0f}".format)


def over_others(wanted: Sequence[str], numbers: Numbers) -> Numbers:
    """Ratio of the numbers at some levels to the lowest at the other levels."""

    def combine(rows: list[Row]) -> tuple[str, pd.Series]:
        known = {str(row.level): float(row.scores.iloc[0]) for row in rows}
        least = min(value for level, value in known.items() if level not in wanted)
        return "all", pd.Series({level: known[level] / max(least, 1e-9) for level in wanted})

    found = _over(numbers, f"ratio of the {numbers.what} to the lowest of the others", combine)
    return replace(found, whose=" and ".join(wanted))


def _of_each(
    numbers: Numbers,
    what: str,
    derive: Callable[[pd.Series], pd.Series],
    whose: str,
    needed: tuple[str, ...] = (),
) -> Numbers:
    def find(witness: Witness, _: tuple[str, ...]) -> list[Row]:
        return [row._replace(scores=derive(row.scores)) for row in numbers.find(witness, needed)]

    return replace(numbers, what=what, whose=whose, find=find)


def _over(
    numbers: Numbers,
    what: str,
    combine: Callable[[list[Row]], tuple[str, pd.Series]],
    *,
    least: int = 1,
    mean: bool = False,
) -> Numbers:
    """Derive one row from all rows; raise if there are none."""

    def find(witness: Witness, methods: tuple[str, ...]) -> list[Row]:
        return [Row(*combine(_need_rows(numbers.find(witness, methods), least)))]

    where = f"on average {numbers.where}" if mean else _over_each(numbers.where)
    return replace(numbers, what=what, find=find, where=where)


def _over_each(where: str) -> str:
    return where.replace("at each", "over each", 1)


def _need_rows(rows: list[Row], least: int) -> list[Row]:
    if len(rows) < least:
        raise NotTestableError(_ONE_LEVEL if least <= 2 else f"the records hold fewer than {least} levels")
    return rows


def _each_method(
    what: str, reduce: Callable[[list[Level], FloatArray], float], *, least: int = 1, every: bool = False
) -> Callable[[Numbers], Numbers]:
    """Return a function that derives one row: for each method, from the levels and its numbers over all rows.

    `every`: all methods of the paper must be there.
    """

    def combine(rows: list[Row]) -> tuple[str, pd.Series]:
        at, table = [row.level for row in rows], pd.DataFrame([row.scores for row in rows])
        found = {method: reduce(at, values.to_numpy(dtype=np.float64)) for method, values in table.items()}
        return f"{rows[0].label} to {rows[-1].label}", pd.Series(found)

    def derive(numbers: Numbers) -> Numbers:
        given = replace(numbers, find=lambda witness, _: numbers.find(witness, ())) if every else numbers
        return _over(given, what.format(numbers.what), combine, least=least)

    return derive


lowest = _each_method("lowest {}", lambda _, values: float(np.nanmin(values)))
spread = _each_method("range of the {}", lambda _, values: float(np.ptp(values)))
swing = _each_method(
    "the smaller of the largest rise and fall between neighbours of {}",
    lambda _, values: float(min(np.diff(values).max(), -np.diff(values).min())),
    least=3,
    every=True,
)
growth = _each_method(
    "Spearman correlation of {} and level",
    lambda at, values: correlate_with_levels(map(float, at), values),
    least=3,
)
