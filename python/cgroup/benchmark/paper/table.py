"""The table for the checks of claims: means by experiment, place, level, method and measure.

`at`, `named` and `nearest` pick some of the levels of an experiment.
"""

import operator as operators
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, NamedTuple

import pandas as pd

from cgroup.benchmark.paper import CHAINED, GENERATED, PLACES, VARIANTS
from cgroup.benchmark.paper.evidence import Evidence, Level, Sample, mean_times
from cgroup.benchmark.problem import COMBINATIONS
from cgroup.benchmark.tables import exponents
from cgroup.registry import PAPER_METHODS
from cgroup.types import IndexArray

COLUMNS = ("experiment", "place", "level", "method", "measure", "value")

ALL = "all"  # level of a mean over all levels
# Method of measures that don't depend on the method: `inlier_ratio` and `correct`
MATCHES = "the initial matches"
TIMING = "timing"  # experiment of the measures `seconds` and `exponent`; its level is n, its place empty
_SCORES = ("precision", "recall", "f_score", "registered", "selected")


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
    """Means, one row per value with the columns `COLUMNS`, and their data by experiment and place."""

    values: pd.DataFrame
    origins: dict[tuple[str, str], Origin]

    def by_level(self, key: tuple[str, str], measure: str) -> pd.DataFrame:
        """Return a measure of an experiment and place: one row per level, one column per method."""
        found = self._read(key, measure)
        found = found[found["level"] != ALL].dropna(subset="value")
        table = found.pivot(index="level", columns="method", values="value")  # noqa: PD010 - unique
        return table.infer_objects()

    def overall(self, key: tuple[str, str], measure: str) -> pd.Series:
        """Return the means of a measure over all levels, by method."""
        found = self._read(key, measure)
        return found[found["level"] == ALL].set_index("method")["value"]

    def _read(self, key: tuple[str, str], measure: str) -> pd.DataFrame:
        return self.values.iloc[self._places.get((*key, measure), [])]

    @cached_property
    def _places(self) -> dict[tuple[str, ...], IndexArray]:
        return self.values.groupby(["experiment", "place", "measure"], sort=False).indices


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
        return self.table.by_level(self.find(source, methods), measure)

    def read_overall(self, source: Source, measure: str, methods: tuple[str, ...] = ()) -> pd.Series:
        """Return the means over all levels, by method."""
        found = self.table.overall(self.find(source, methods), measure)
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
    parts = [pd.DataFrame(columns=list(COLUMNS))]
    origins: dict[tuple[str, str], Origin] = {}
    chained = (evidence.same_cases(place, CHAINED) for place in VARIANTS.places)
    for sample in (*evidence.samples(every_method=False), *filter(None, chained)):
        experiment, place = sample.experiment.id, sample.place
        generated = (sample.dataset,) if sample.is_generated else ()
        origins[experiment, place] = Origin(
            tuple(sorted(sample.rows["method"].unique())), sample.description, generated
        )
        parts += [part.assign(experiment=experiment, place=place) for part in _measure(sample)]
    timing = evidence.timing
    times = mean_times(timing[timing["method"].isin(PAPER_METHODS)]) if len(timing) else timing
    if len(times):
        generated = tuple(name for name in timing["dataset"].unique() if name.startswith(GENERATED))
        origins[TIMING, ""] = Origin(tuple(times.columns), "timing experiment", generated)
        seconds = times.rename_axis(index="level").reset_index().melt("level", value_name="seconds")
        fitted = exponents(timing).dropna(subset="exponent").assign(level=ALL)
        parts += [
            _melt(each).assign(experiment=TIMING, place="")
            for each in (seconds, fitted[["level", "method", "exponent"]])
        ]
    return ClaimTable(pd.concat([part for part in parts if len(part)] or parts, ignore_index=True), origins)


def _measure(sample: Sample) -> Iterator[pd.DataFrame]:
    """Yield rows of the long table."""
    precision, registered = sample.rows["precision"], sample.rows["registered"].astype(bool)
    shares = {
        "pairs with P > 0.5": precision > 0.5,
        "pairs with P > 0.1": precision > 0.1,
        "registered pairs with P > 0.5": (precision > 0.5).astype(float).where(registered),
        "failed pairs with P <= 0.05": (precision <= 0.05 + 1e-12).astype(float).where(~registered),
    }
    keys = sample.rows[["method"]].assign(level=sample.rows["x"])
    numbers = pd.concat([keys, sample.rows[list(_SCORES)].assign(**shares).astype(float)], axis="columns")
    yield _melt(numbers.groupby(["level", "method"]).mean().reset_index())
    yield _melt(numbers.drop(columns="level").groupby("method").mean().reset_index().assign(level=ALL))
    steps = sample.smallest_steps("precision").rename("smallest step of P")
    yield _melt(steps.reset_index().assign(level=ALL))
    matches = pd.DataFrame({name: sample.matches(name) for name in ("inlier_ratio", "correct")})
    yield _melt(matches.rename_axis("level").reset_index().assign(method=MATCHES))


def _melt(means: pd.DataFrame) -> pd.DataFrame:
    """Return one row per level, method and measure."""
    return means.astype({"level": object}).melt(["level", "method"], var_name="measure")


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
