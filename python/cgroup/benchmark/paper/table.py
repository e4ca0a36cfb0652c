"""Means for the checks of claims, by experiment, place, measure, level and method.

`at`, `named` and `nearest` pick some of the levels of an experiment.
"""

import operator as operators
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, TypeAlias

import pandas as pd

from cgroup.benchmark.paper import CHAINED, GENERATED, PLACES, VARIANTS
from cgroup.benchmark.paper.evidence import Evidence, Level, Sample, mean_times
from cgroup.benchmark.problem import COMBINATIONS
from cgroup.benchmark.tables import exponents
from cgroup.registry import PAPER_METHODS

# Method of measures that don't depend on the method: `inlier_ratio` and `correct`
MATCHES = "the initial matches"
TIMING = "timing"  # experiment of the measures `seconds` and `exponent`; its level is n, its place empty
_SCORES = ("precision", "recall", "f_score", "registered", "selected")
Key: TypeAlias = tuple[tuple[str, str], str]  # experiment and place, and measure


class NotTestableError(Exception):
    """Records that a claim needs are missing; the message names them."""


class Source(NamedTuple):
    """Part of the table: an experiment on a data set of the paper, or on its replacement."""

    experiment: str
    place: str
    otherwise: str = ""


class Origin(NamedTuple):
    """Data behind a part of the table: its methods, a description, and the generated data sets in it."""

    methods: tuple[str, ...]
    description: str
    generated: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ClaimTable:
    """Means by experiment, place and measure, and their data by experiment and place.

    `levels` have a row per level and a column per method; `overall` are over all levels, by method.
    """

    levels: dict[Key, pd.DataFrame] = field(default_factory=dict)
    overall: dict[Key, pd.Series] = field(default_factory=dict)
    origins: dict[tuple[str, str], Origin] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Witness:
    """The table for one claim: records the used data, and raises if data are missing."""

    table: ClaimTable
    used: dict[tuple[str, str], Origin] = field(default_factory=dict)

    def find(self, source: Source, methods: tuple[str, ...] = ()) -> tuple[str, str]:
        """Return the experiment and place with records of some methods, or of the paper's nine."""
        key = (source.experiment, source.place)
        origin = self.table.origins.get(key)
        if origin is None:
            wanted = (
                f" on {source.place} (data sets: {', '.join(PLACES[source.place])})" if source.place else ""
            )
            message = f"no records of experiment '{source.experiment}'{wanted}"
        else:
            self.used[key] = origin
            missing = [each for each in methods or PAPER_METHODS if each not in origin.methods]
            if not missing:
                return key
            names = ", ".join(name.upper() for name in missing)
            message = f"no records of {names} in experiment '{source.experiment}': {origin.description}"
        if source.otherwise and (source.experiment, source.otherwise) in self.table.origins:
            return self.find(Source(source.experiment, source.otherwise), methods)
        raise NotTestableError(message)

    def read_levels(self, source: Source, measure: str, methods: tuple[str, ...] = ()) -> pd.DataFrame:
        """Return one row per level and one column per method."""
        return self.table.levels[self.find(source, methods), measure]

    def read_overall(self, source: Source, measure: str, methods: tuple[str, ...] = ()) -> pd.Series:
        """Return the means over all levels, by method."""
        found = self.table.overall[self.find(source, methods), measure]
        missing = [each for each in methods if each not in found.index]
        if missing:
            message = f"no {measure} of {', '.join(name.upper() for name in missing)}: too few records"
            raise NotTestableError(message)
        return found

    def describe(self) -> str:
        """Name the data that the claim used."""
        return "; ".join(dict.fromkeys(origin.description for origin in self.used.values()))


def make_table(evidence: Evidence) -> ClaimTable:
    """Compute all means that the claims compare."""
    table = ClaimTable()
    chained = (evidence.same_cases(place, CHAINED) for place in VARIANTS.places)
    for sample in (*evidence.samples(every_method=False), *filter(None, chained)):
        _add_sample(table, sample)
    timing = evidence.timing
    times = mean_times(timing[timing["method"].isin(PAPER_METHODS)]) if len(timing) else timing
    if len(times):
        generated = tuple(name for name in timing["dataset"].unique() if name.startswith(GENERATED))
        table.origins[TIMING, ""] = Origin(tuple(times.columns), "timing experiment", generated)
        table.levels[(TIMING, ""), "seconds"] = times
        table.overall[(TIMING, ""), "exponent"] = exponents(timing).set_index("method")["exponent"].dropna()
    return table


def _add_sample(table: ClaimTable, sample: Sample) -> None:
    key = sample.experiment.id, sample.place
    methods = tuple(sorted(sample.rows["method"].unique()))
    generated = (sample.dataset,) if sample.is_generated else ()
    table.origins[key] = Origin(methods, sample.description, generated)
    precision, registered = sample.rows["precision"], sample.rows["registered"].astype(bool)
    shares = {
        "pairs with P > 0.5": precision > 0.5,
        "pairs with P > 0.1": precision > 0.1,
        "registered pairs with P > 0.5": (precision > 0.5).astype(float).where(registered),
        "failed pairs with P <= 0.05": (precision <= 0.05 + 1e-12).astype(float).where(~registered),
    }
    numbers = sample.rows[list(_SCORES)].assign(**shares).astype(float)
    method, level = sample.rows["method"], sample.rows["x"].rename("level")
    by_level = numbers.groupby([level, method]).mean().unstack("method")  # noqa: PD010 - of means
    overall = numbers.groupby(method).mean()
    overall["smallest step of P"] = sample.smallest_steps("precision")
    for measure in numbers:
        known = by_level[measure].dropna(how="all").dropna(axis="columns", how="all")
        table.levels[key, str(measure)] = known
    for name in ("inlier_ratio", "correct"):
        table.levels[key, name] = sample.matches(name).dropna().rename(MATCHES).to_frame()
    for measure, means in overall.items():
        table.overall[key, str(measure)] = means


_SIDES = {
    "<": (operators.lt, "below"),
    "<=": (operators.le, "at or below"),
    ">": (operators.gt, "above"),
    ">=": (operators.ge, "from"),
}


class Pick(NamedTuple):
    """Some of the levels: their description, and a function that selects them."""

    words: str
    choose: Callable[[Sequence[Level]], list[Level]]


def at(operator: Literal["<", "<=", ">", ">="], bound: float) -> Pick:
    """Levels on one side of a bound; at least one must exist."""
    compare, words = _SIDES[operator]

    def choose(known: Sequence[Level]) -> list[Level]:
        chosen = [level for level in known if compare(round(float(level), 6), bound)]
        if not chosen:
            raise NotTestableError(f"the records hold no level {words} {bound:g}")
        return chosen

    return Pick(f"{words} {bound:g}", choose)


def named(*wanted: Level) -> Pick:
    """Levels that a statement names; all must exist."""

    def choose(known: Sequence[Level]) -> list[Level]:
        missing = [str(each) for each in wanted if each not in known]
        if missing:
            raise NotTestableError("the records lack the level " + ", ".join(missing))
        return list(wanted)

    return Pick(
        "of the six" if wanted == tuple(COMBINATIONS) else "of " + " and ".join(map(str, wanted)), choose
    )


def nearest(level: float, low: float, high: float, *, optional: bool = False) -> Pick:
    """Level nearest to a value, within bounds; it must exist unless it is optional."""

    def choose(known: Sequence[Level]) -> list[Level]:
        within = [each for each in known if low <= round(float(each), 6) <= high]
        if not within and not optional:
            raise NotTestableError(f"the records hold no level around {level:g}")
        return sorted(within, key=lambda each: abs(float(each) - level))[:1]

    within = f"within {low:g} to {high:g}{', if there is one' if optional else ''}"
    return Pick(f"nearest to {level:g} ({within})", choose)
