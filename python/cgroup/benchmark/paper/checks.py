"""What claims are made of: numbers from the records, and checks of them that say themselves what they test.

`Numbers` pick scores of the methods: those of each level of an experiment, or means over all levels. A
`Check` compares them; its criterion is worded by the function that makes it. Checks join by ``&``.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from scipy import stats

from cgroup.benchmark.means import FITTED_FROM
from cgroup.benchmark.paper import EXPERIMENTS, GENERATED, PLACES

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from cgroup.benchmark.paper.evidence import Evidence, Level, Sample

TIE = 0.01
LARGE = 0.1
CLEAR = 0.05
TIME_TIE = math.log(1.05)
"""Tolerances on scores, and on logarithms of times."""

COMBINATIONS = ("C1", "C2", "C3", "C4", "C5", "C6")
"""Of detector and descriptor, as the paper numbers them."""

_WHAT = {
    "precision": "P",
    "recall": "R",
    "f_score": "F",
    "registered": "rate",
    "selected": "size of the group",
}
_LEVELS = {  # of an experiment: how one is named, and what they are
    "noise": ("noise {} pr", "level of noise"),
    "density": ("{} kept", "share of the points kept"),
    "epsilon": ("ε {} pr", "threshold"),
    "matches": ("n {}", "number of matches"),
    "combinations": ("{}", "combination"),
}
_HOW_MANY = {1: "", 2: "two ", 3: "three ", 4: "four "}
_NTH = {1: "best other", 2: "second of the others", 3: "third of the others"}

_ONE_LEVEL = "the records hold one level only"

Operator: TypeAlias = Literal[">", ">=", "<", "<="]


class Comparison(NamedTuple):
    """Whether numbers are as a claim says, in words, and by how much; NaN where a number is missing."""

    holds: bool
    text: str
    margin: float


class NotTestableError(Exception):
    """Records that a claim needs are missing; the message says which."""


@dataclass(frozen=True, eq=False)
class Witness:
    """Evidence as one claim asks for it: remembers what was used, and refuses what is missing."""

    all: Evidence
    used: list[Sample | str] = field(default_factory=list)

    def need(self, source: Source, *methods: str) -> Sample:
        """Find the records of an experiment with all nine methods, or those named."""
        sample = self.all.sample(source.experiment, source.place)
        if sample is None:
            wanted = ", ".join(PLACES[source.place])
            message = (
                f"no records of experiment '{source.experiment}' on {source.place} (data sets: {wanted})"
            )
        else:
            missing = self._remember(sample, methods, sample.methods)
            if not missing:
                return sample
            message = f"no records of {missing} in experiment '{source.experiment}' on {sample.dataset}"
        if source.otherwise and self.all.sample(source.experiment, source.otherwise) is not None:
            return self.need(Source(source.experiment, source.otherwise), *methods)
        raise NotTestableError(message)

    def need_same_cases(self, place: str, methods: tuple[str, ...]) -> Sample:
        """Find the records of some methods on the cases that all of them were run on."""
        sample = self.all.same_cases(place, methods)
        if sample is None:
            names = ", ".join(map(_name, methods))
            message = f"no case on {place} with {names}; run an experiment with these methods"
            raise NotTestableError(message)
        self._remember(sample, (), self.all.methods)
        return sample

    def need_times(self, *methods: str) -> pd.DataFrame:
        """Find the mean seconds on one thread: one row per n, one column per method of the paper."""
        times = self.all.mean_times
        missing = _missing(methods or self.all.methods, times.columns)
        if missing:
            message = f"no times of {missing}; run the timing experiment"
            raise NotTestableError(message)
        self._remember("timing experiment", (), self.all.methods)
        return times

    def describe(self) -> str:
        """Name what the claim has asked for."""
        named = (each if isinstance(each, str) else each.description for each in self.used)
        return "; ".join(dict.fromkeys(named))

    def list_generated(self) -> list[str]:
        """List data sets that the claim has asked for of which there are generated shapes only."""
        found: list[str] = []
        for each in self.used:
            if isinstance(each, str):
                found += [n for n in self.all.timing["dataset"].unique() if n.startswith(GENERATED)]
            elif each.is_generated:
                found.append(each.dataset)
        return list(dict.fromkeys(found))

    def _remember(self, asked: Sample | str, methods: Sequence[str], there: Iterable[str]) -> str:
        """Note what was asked for; name the methods that it lacks."""
        if asked not in self.used:
            self.used.append(asked)
        return _missing(methods or self.all.methods, there)


# --- Checks -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Check:
    """A test of the records that words its own criterion; it has no tests if it only adds to the summary."""

    criterion: str
    find: Callable[[Witness], Sequence[Comparison]]
    need: Literal["all", "most"] = "all"
    summarize: Callable[[Witness], str] = lambda _: ""

    def __and__(self, other: Check) -> Check:
        """Test both."""
        return Check(
            "; ".join(filter(None, (self.criterion, other.criterion))),
            lambda evidence: [*self.find(evidence), *other.find(evidence)],
            self.need,
            lambda evidence: " ".join(filter(None, (self.summarize(evidence), other.summarize(evidence)))),
        )


def most(check: Check) -> Check:
    """More than half of the tests have to hold."""
    return replace(check, criterion=f"in more than half of the cases: {check.criterion}", need="most")


def share(operator: Operator, bound: float, check: Check) -> Check:
    """Make one test of several: which share of them holds."""

    def find(evidence: Witness) -> list[Comparison]:
        holding = [test.holds for test in check.find(evidence)]
        label = f"{check.criterion}: {sum(holding)} of {len(holding)}, share"
        return [compare(label, float(np.mean(holding)), operator, bound)]

    return Check(f"share {operator} {bound:g} of the cases in which {check.criterion}", find)


def in_top(tops: Mapping[str, int], numbers: Numbers) -> Check:
    """Each of some methods among the best k, which are given by method."""
    words = [
        f"{_names(method for method in tops if tops[method] == k)} "
        f"{'among ' if k > 1 else ''}the {_HOW_MANY[k]}{numbers.superlative}"
        for k in dict.fromkeys(tops.values())
    ]
    return _at_each(
        f"{numbers.what} of {', of '.join(words)}",
        numbers,
        lambda row: [expect_in_top(row, method, k, numbers) for method, k in tops.items()],
    )


def cells(numbers: Numbers, operator: Operator, bound: float, methods: Sequence[str] = ()) -> Check:
    """Each number of some methods, or of all, against a bound."""
    return _at_each(
        f"{numbers.what} of {numbers.name(methods)} {operator} {bound:g}",
        numbers,
        lambda row: [
            compare(f"{row.label}, {numbers.what} of {_name(method)}", value, operator, bound)
            for method, value in _choose(row, methods)
        ],
        methods,
    )


def higher(one: str, others: Sequence[str], numbers: Numbers, *, twice: bool = False) -> Check:
    """One method's number above that of each of the others by more than a tie; or times, more than twice."""
    by, than = (math.log(2), "more than twice") if twice else (numbers.tie, "higher than")

    def test(row: Row, other: str) -> Comparison:
        margin = float(row.scores[one] - row.scores[other] - by)
        pair = ", ".join(f"{_name(each)} {numbers.show(row.scores[each])}" for each in (one, other))
        return Comparison(margin > 0, f"{row.label}, {numbers.what}: {pair}", margin)

    return _at_each(
        f"{numbers.what} of {_name(one)} {than} that of {_names(others)}",
        numbers,
        lambda row: [test(row, other) for other in others],
        (one, *others),
    )


def higher_mean(ones: Sequence[str], others: Sequence[str], numbers: Numbers) -> Check:
    """Mean over some methods above the mean over others by more than a tie."""

    def test(row: Row) -> list[Comparison]:
        means = [float(row.scores[list(each)].mean()) for each in (ones, others)]
        pair = ", ".join(f"{show_score(m)} ({_names(g)})" for m, g in zip(means, (ones, others), strict=True))
        margin = means[0] - means[1] - TIE
        return [Comparison(margin > 0, f"{row.label}: mean {numbers.what} {pair}", margin)]

    return _at_each(
        f"mean {numbers.what} of {_names(ones)} higher than that of {_names(others)}", numbers, test
    )


def about(expected: Mapping[float, float], within: float, numbers: Numbers) -> Check:
    """Numbers near given ones, by level."""

    def test(row: Row) -> list[Comparison]:
        ((name, value),) = _choose(row, ())
        wanted = expected[float(row.level)]
        text = f"{row.label}, {numbers.what} of {_name(name)} {value:+.2f} (paper about {wanted:.2f})"
        return [Comparison(abs(value - wanted) <= within, text, within - abs(value - wanted))]

    words = " and ".join(f"{value:g}" for value in expected.values())
    return _at_each(f"{numbers.what} of {numbers.name()} {words}, within {within:g},", numbers, test)


def ranks(method: str, first: int, last: int, numbers: Numbers) -> Check:
    """One method's rank, which is 1 + the number of methods that are better by more than a tie."""

    def test(row: Row) -> list[Comparison]:
        at = rank(row.scores, method)
        text = f"{_name(method)} {numbers.show(row.scores[method])}, rank {at} of {len(row.scores)}"
        margin = float(min(at - first, last - at))
        return [Comparison(first <= at <= last, f"{row.label}: {numbers.what} of {text}", margin)]

    return _at_each(f"{numbers.what} of {_name(method)} has rank {first} to {last}", numbers, test)


def beside_median(methods: Sequence[str], operator: Operator, by: float, numbers: Numbers) -> Check:
    """Numbers of some methods, minus the median of all, against a bound."""

    def test(row: Row, method: str) -> Comparison:
        value, median = row.scores[method], row.scores.median()
        text = f"{numbers.show(value)}, median of the methods {numbers.show(median)}, difference"
        label = f"{row.label}: {numbers.what} of {_name(method)} {text}"
        return compare(label, value - median, operator, by)

    words = f"{numbers.what} of {_names(methods)} minus the median of the methods {operator} {by:g}"
    return _at_each(words, numbers, lambda row: [test(row, method) for method in methods])


def alike(one: str, other: str, within: float, numbers: Numbers) -> Check:
    """Two methods' numbers differ by less than a bound."""

    def test(row: Row) -> list[Comparison]:
        pair = ", ".join(f"{_name(each)} {row.scores[each]:.2f}" for each in (one, other))
        difference = float(np.abs(row.scores[one] - row.scores[other]))
        return [compare(f"{row.label}: {numbers.what} of {pair}, difference", difference, "<", within)]

    words = f"{numbers.what} of {_names((one, other))} differs by less than {within:g}"
    return _at_each(words, numbers, test, (one, other))


def changes(
    numbers: Numbers,
    operator: Operator,
    bound: float,
    methods: Sequence[str] = (),
    since: float | None = None,
) -> Check:
    """How far numbers rise from the first to the last, or since a level, against a bound."""

    def test(rows: list[Row]) -> Iterator[Comparison]:
        passed = [k for k, row in enumerate(rows) if since is not None and float(row.level) <= since]
        first, last = rows[passed[-1] if passed else 0], rows[-1]
        if first is last:
            raise NotTestableError(_ONE_LEVEL)
        for method, start in _choose(first, methods):
            end = last.scores[method]
            text = f"{show_score(start)} at {first.label}, {show_score(end)} at {last.label}: change"
            yield compare(f"{numbers.what} of {_name(method)} {text}", end - start, operator, bound)

    start = "the first" if since is None else f"about {since:g}"
    words = (
        f"{numbers.what} of {numbers.name(methods)} changes by {operator} {bound:g} from {start} to the last"
    )
    return _along(words, numbers, test, least=2, methods=methods)


def follows(numbers: Numbers, least: float) -> Check:
    """Each method's rank correlation with the level."""

    def test(rows: list[Row]) -> Iterator[Comparison]:
        for method in rows[0].scores.index:
            growth = correlate_with_levels(
                [float(row.level) for row in rows], [row.scores[method] for row in rows]
            )
            yield compare(f"Spearman of {numbers.what} and level, {_name(method)}", growth, ">=", least)

    return _along(
        f"Spearman of {numbers.what} and level >= {least:g} for each method", numbers, test, least=3
    )


def stable(numbers: Numbers, least: float, *, mean: bool = False) -> Check:
    """Kendall's τ between the rankings at neighbouring levels; or its mean over any two levels."""
    of_what = f"Kendall τ between the rankings by {numbers.what}"

    def test(rows: list[Row]) -> Iterator[Comparison]:
        pairs = list(itertools.combinations(rows, 2) if mean else itertools.pairwise(rows))
        taus = [compare_rankings(one.scores, other.scores) for one, other in pairs]
        if mean:
            yield compare(f"mean {of_what}:", sum(taus) / len(taus), ">=", least)
            return
        for (one, other), tau in zip(pairs, taus, strict=True):
            yield compare(f"{of_what}, {one.label} and {other.label}:", tau, ">=", least)

    which = f"mean {of_what}, taken of any two," if mean else f"{of_what} of neighbours"
    return _along(f"{which} >= {least:g}", numbers, test, least=2)


def fluctuate(methods: Sequence[str], numbers: Numbers) -> Check:
    """Numbers both rise and fall by more than a tie between neighbouring levels."""

    def test(rows: list[Row]) -> Iterator[Comparison]:
        at = ", ".join(row.label for row in rows)
        for method in methods:
            values = [row.scores[method] for row in rows]
            smaller = min(float(np.diff(values).max()), float(-np.diff(values).min()))
            shown = ", ".join(f"{value:.2f}" for value in values)
            yield Comparison(
                smaller > TIE, f"{numbers.what} of {_name(method)} {shown} ({at})", smaller - TIE
            )

    words = (
        f"{numbers.what} of {_names(methods)} both rises and falls by more than {TIE:g} between neighbours"
    )
    return _along(words, numbers, test, least=3)


def best_with(wanted: Sequence[str], numbers: Numbers, methods: Sequence[str] = ()) -> Check:
    """Each method's number is highest at one of these levels, ties included."""

    def test(rows: list[Row]) -> Iterator[Comparison]:
        for method in methods or rows[0].scores.index:
            known = {str(row.level): float(row.scores[method]) for row in rows}
            known = {level: value for level, value in known.items() if not math.isnan(value)}
            others = [level for level in known if level not in wanted]
            if others:
                here = max((known[level] for level in wanted if level in known), default=math.nan)
                best = max(others, key=known.__getitem__)
                with_these = f"{show_score(here)} with {' or '.join(wanted)}"
                text = (
                    f"{numbers.what} of {_name(method)} {with_these}, {show_score(known[best])} with {best}"
                )
                yield Comparison(here >= known[best] - TIE, text, here - known[best])

    return _along(f"{numbers.what} of {numbers.name(methods)} best with {' or '.join(wanted)}", numbers, test)


def orders_differ(methods: Sequence[str], numbers: Numbers) -> Check:
    """Require that some methods don't come in the same order at all levels."""

    def test(rows: list[Row]) -> list[Comparison]:
        orders = {tuple(row.scores[list(methods)].sort_values().index) for row in rows}
        text = f"{_names(methods)} come in {len(orders)} different orders"
        return [Comparison(len(orders) > 1, text, float(len(orders) - 1))]

    return _along(f"more than one order of {_names(methods)} by {numbers.what}", numbers, test)


def over_levels(
    which: Literal["lowest", "range of the"],
    numbers: Numbers,
    operator: Operator,
    bound: float,
    methods: Sequence[str] = (),
) -> Check:
    """Compare the lowest of each method's numbers, or how far apart they lie, with a bound."""

    def test(rows: list[Row]) -> Iterator[Comparison]:
        for method, _ in _choose(rows[0], methods):
            values = np.array([row.scores[method] for row in rows], dtype=float)
            value = float(np.nanmin(values) if which == "lowest" else np.ptp(values))
            yield compare(f"{which} {numbers.what} of {_name(method)}", value, operator, bound)

    words = f"{which} {numbers.what} of {numbers.name(methods)} {operator} {bound:g}"
    return _along(words, numbers, test, methods=methods)


def trails(method: str, by: float, numbers: Numbers) -> Check:
    """One method is behind the next worst by more than a bound at each level."""

    def test(rows: list[Row]) -> list[Comparison]:
        gaps = [float(row.scores.drop(method).min() - row.scores[method]) for row in rows]
        return [
            compare(f"{_name(method)} behind the next worst by at least", float(np.nanmin(gaps)), ">", by)
        ]

    return _along(f"{numbers.what} of {_name(method)} more than {by:g} behind the next worst", numbers, test)


def never_falls(column: str, source: Source) -> Check:
    """No pair's number falls from one level to the next, up to rounding."""

    def find(evidence: Witness) -> list[Comparison]:
        sample = evidence.need(source)
        if len(sample.by_level(column)) < 2:
            raise NotTestableError(_ONE_LEVEL)
        return [
            Comparison(
                bool(step >= -1e-9), f"{_name(method)}: smallest step of a pair {step:+.3f}", float(step)
            )
            for method, step in sample.smallest_steps(column).items()
        ]

    where = f"from one {_level_noun(source)} to the next on {source.place}"
    return Check(f"no pair's {_WHAT[column]} falls {where}, for each method", find)


def fewer_matches(wanted: Sequence[str], factor: float, source: Source) -> Check:
    """Fewer correct matches come with some combinations than with any other."""

    def find(evidence: Witness) -> Iterator[Comparison]:
        counts = evidence.need(source).matches("correct")
        counts = counts.loc[named(*COMBINATIONS).choose(list(counts.index))]
        least = float(counts.drop(list(wanted)).min())
        for name in wanted:
            label = f"{name}: {counts[name]:.0f} correct matches, others {least:.0f} or more: ratio"
            yield compare(label, counts[name] / max(least, 1e-9), "<=", factor)

    words = f"mean number of correct matches with {' and with '.join(wanted)}"
    words += f" <= {factor:g} times the least of the other combinations on {source.place}"
    return Check(words, lambda evidence: list(find(evidence)))


def pairs_with(
    method: str,
    precision: tuple[Operator, float],
    operator: Operator,
    bound: float,
    source: Source,
    *,
    registered: bool | None = None,
) -> Check:
    """Compare the share of pairs with some precision: of all, of the registered ones, or of the others."""
    name = {None: "pairs", True: "registered pairs", False: "failed pairs"}[registered]
    what = f"with P {precision[0]} {precision[1]:g}"

    def find(evidence: Witness) -> list[Comparison]:
        sample = evidence.need(source, method)
        among = sample.rows["method"] == method
        if registered is not None:
            among &= sample.rows["registered"].astype(bool) == registered
        holds = _OPERATORS[precision[0]](sample.rows["precision"], precision[1])
        label = f"{_name(method)}: share of {sample.count(among)} {name} {what}"
        return [compare(label, sample.share(holds, among), operator, bound)]

    words = f"share {operator} {bound:g} of the {name} of {_name(method)} on {source.place} {what}"
    return Check(words, find)


def linear(method: str, exponent: float, seconds: float) -> Check:
    """Bound the exponent with which a method's time grows, and its time for the largest set."""
    name = _name(method)

    def find(evidence: Witness) -> list[Comparison]:
        found = evidence.need_times(method)[method]
        fitted = evidence.all.exponents[method]
        if np.isnan(fitted):
            message = f"times of fewer than two n from {FITTED_FROM}"
            raise NotTestableError(message)
        slow = float(found.iloc[-1])
        fast = Comparison(slow < seconds, f"{show_time(np.log(slow))} at n {found.index[-1]}", seconds - slow)
        return [compare(f"exponent of {name}", fitted, "<=", exponent), fast]

    return Check(
        f"fitted exponent of {name} <= {exponent:g}; time of {name} < {seconds:g} s at the largest n", find
    )


def listed(numbers: Numbers, title: str) -> Check:
    """No test: name what a row has, the best first, in the summary."""

    def summarize(evidence: Witness) -> str:
        (row,) = numbers.find(evidence, ())
        ordered = row.scores.sort_values(ascending=False, kind="stable").items()
        return f"{title}: {', '.join(f'{_name(str(name))} {numbers.show(v)}' for name, v in ordered)}."

    return Check("", lambda _: [], summarize=summarize)


def with_means(numbers: Numbers) -> Check:
    """No test: name the mean over all methods of each row in the summary."""

    def summarize(evidence: Witness) -> str:
        means = (f"{row.label} {show_score(row.scores.mean())}" for row in numbers.find(evidence, ()))
        return f"Mean {numbers.what} over all methods: {', '.join(means)}."

    return Check("", lambda _: [], summarize=summarize)


def with_correlation(numbers: Numbers) -> Check:
    """No test: name the rank correlation of the level and a single number in the summary."""

    def summarize(evidence: Witness) -> str:
        values = [float(row.scores.iloc[0]) for row in numbers.find(evidence, ())]
        growth = correlate_with_levels(range(len(values)), values)
        return f"Spearman of {numbers.what} and level over all levels: {growth:.2f}."

    return Check("", lambda _: [], summarize=summarize)


def with_exponents(*methods: str) -> Check:
    """No test: name the exponents of some methods' times in the summary."""

    def summarize(evidence: Witness) -> str:
        fitted = evidence.all.exponents
        known = [
            f"{_name(method)} {fitted[method]:.2f}" for method in methods if not np.isnan(fitted[method])
        ]
        return f"Exponents: {', '.join(known)}." if known else ""

    return Check("", lambda _: [], summarize=summarize)


def _at_each(
    words: str, numbers: Numbers, test: Callable[[Row], list[Comparison]], methods: Sequence[str] = ()
) -> Check:
    """Test each row by itself."""
    return Check(
        f"{words} {numbers.where}",
        lambda evidence: [found for row in numbers.find(evidence, methods) for found in test(row)],
    )


def _along(
    words: str,
    numbers: Numbers,
    test: Callable[[list[Row]], Iterable[Comparison]],
    *,
    least: int = 1,
    methods: Sequence[str] = (),
) -> Check:
    """Test the rows together, of which there have to be some."""

    def find(evidence: Witness) -> list[Comparison]:
        rows = numbers.find(evidence, methods)
        if len(rows) < least:
            message = _ONE_LEVEL if least == 2 else f"the records hold fewer than {least} levels"
            raise NotTestableError(message)
        return list(test(rows))

    return Check(f"{words}, {numbers.where.replace('at each', 'over each', 1)}", find)


# --- Numbers ------------------------------------------------------------------------------------------------


class Source(NamedTuple):
    """Records: an experiment on a data set of the paper, or on another one where there are none."""

    experiment: str
    place: str
    otherwise: str = ""


class Row(NamedTuple):
    """Numbers of the methods at a level, or wherever the label says."""

    label: str
    scores: pd.Series
    level: Level = ""


class Pick(NamedTuple):
    """Some of the levels: in words, and a choice of those that there are."""

    words: str
    choose: Callable[[Sequence[Level]], list[Level]]


@dataclass(frozen=True)
class Numbers:
    """Rows of numbers: what they are, where they are from, whose they are, and how they are shown."""

    what: str
    where: str
    find: Callable[[Witness, Sequence[str]], list[Row]]
    whose: str = "each method"
    show: Callable[[float], str] = lambda value: show_score(value)  # noqa: PLW0108 - defined below
    tie: float = TIE
    superlative: str = "best"

    def name(self, methods: Sequence[str] = ()) -> str:
        """Name some methods, or whose numbers they all are."""
        return _names(methods) if methods else self.whose


def below(bound: float) -> Pick:
    """Levels under a bound."""
    return _pick(f"below {bound:g}", lambda level: level < bound)


def up_to(bound: float) -> Pick:
    """Levels of a bound or less."""
    return _pick(f"at or below {bound:g}", lambda level: level <= bound)


def above(bound: float) -> Pick:
    """Levels over a bound."""
    return _pick(f"above {bound:g}", lambda level: level > bound)


def from_(bound: float) -> Pick:
    """Levels of a bound or more."""
    return _pick(f"from {bound:g}", lambda level: level >= bound)


def named(*wanted: Level) -> Pick:
    """Levels that a statement names; all have to be there."""

    def choose(known: Sequence[Level]) -> list[Level]:
        missing = [str(each) for each in wanted if each not in known]
        if missing:
            message = "the records lack the level " + ", ".join(missing)
            raise NotTestableError(message)
        return list(wanted)

    return Pick("of the six" if wanted == COMBINATIONS else "of " + " and ".join(map(str, wanted)), choose)


def nearest(level: float, low: float, high: float, *, optional: bool = False) -> Pick:
    """Pick the level nearest to one, within bounds; none is an error, or all right."""

    def choose(known: Sequence[Level]) -> list[Level]:
        within = [each for each in known if low <= round(float(each), 6) <= high]
        if not within and not optional:
            message = f"the records hold no level around {level:g}"
            raise NotTestableError(message)
        return sorted(within, key=lambda each: abs(float(each) - level))[:1]

    within = f"within {low:g} to {high:g}{', if there is one' if optional else ''}"
    return Pick(f"nearest to {level:g} ({within})", choose)


def levels(column: str, *given: Source | Pick) -> Numbers:
    """Means over pairs: a row for each level of some experiments, or each that is picked."""
    sources = [each for each in given if isinstance(each, Source)]
    pick = next((each for each in given if isinstance(each, Pick)), None)

    def find(evidence: Witness, methods: Sequence[str]) -> list[Row]:
        tables = ((sample, sample.by_level(column)) for sample in _need(evidence, sources, methods))
        return [
            Row(name_level(sample, level), table.loc[level], level)
            for sample, table in tables
            for level in (pick.choose(list(table.index)) if pick else table.index)
        ]

    return Numbers(_WHAT[column], _at(sources, pick), find)


def match_ratio(*given: Source | Pick) -> Numbers:
    """Shares of correct ones among the initial matches: as `levels`, but no method has a part in them."""
    numbers = levels("precision", *given)
    sources = [each for each in given if isinstance(each, Source)]

    def find(evidence: Witness, _: Sequence[str]) -> list[Row]:
        ratios = {
            name_level(sample, level): ratio
            for sample in _need(evidence, sources, ())
            for level, ratio in sample.matches("inlier_ratio").items()
        }
        return [
            row._replace(scores=pd.Series({"the initial matches": ratios[row.label]}))
            for row in numbers.find(evidence, ())
        ]

    return replace(numbers, what="mean inlier ratio", find=find, whose="the initial matches")


def overall(column: str, *sources: Source) -> Numbers:
    """Means over all levels: a row for each place."""

    def find(evidence: Witness, methods: Sequence[str]) -> list[Row]:
        samples = _need(evidence, sources, methods)
        return [Row(sample.place, sample.overall(column)) for sample in samples]

    where = f"over all levels of {_join([f'{each.experiment} ({each.place})' for each in sources])}"
    show = (lambda value: f"{value:.0f}") if column == "selected" else show_score
    return Numbers(_WHAT[column], where, find, show=show)


def together(*several: Numbers) -> Numbers:
    """Join the rows of several numbers of one kind."""
    where = " and ".join(each.where for each in several)
    return replace(
        several[0],
        where=where,
        find=lambda evidence, methods: [row for each in several for row in each.find(evidence, methods)],
    )


def lead(methods: Sequence[str], numbers: Numbers, *, worst: bool = False) -> Numbers:
    """How far the mean of some methods, or the worst of them, is above the best of the others."""

    def find_lead(row: Row) -> pd.Series:
        is_named = row.scores.index.isin(list(methods))
        ours = row.scores[is_named].min() if worst else row.scores[is_named].mean()
        return pd.Series({_names(methods): ours - row.scores[~is_named].max()})

    which = "the lowest of " if worst else "the mean of " if len(methods) > 1 else ""
    return replace(
        numbers,
        what=f"lead in {numbers.what}",
        whose=f"{which}{_names(methods)} over the best other",
        find=lambda evidence, _: [row._replace(scores=find_lead(row)) for row in numbers.find(evidence, ())],
    )


def mean_of(numbers: Numbers, *, skipna: bool = True) -> Numbers:
    """Average over all rows; missing numbers are skipped, or make the mean missing."""

    def find(evidence: Witness, methods: Sequence[str]) -> list[Row]:
        rows = numbers.find(evidence, methods)
        table = _stack(rows)
        return [Row(f"mean from {rows[0].label} to {rows[-1].label}", table.mean(skipna=skipna))]

    return replace(numbers, where=f"on average {numbers.where}", find=find)


def across(method: str, numbers: Numbers) -> Numbers:
    """One row: a method's number at each level."""

    def find(evidence: Witness, _: Sequence[str]) -> list[Row]:
        rows = numbers.find(evidence, ())
        return [Row(_name(method), _stack(rows)[method].set_axis([row.label for row in rows]))]

    return replace(numbers, find=find)


def change(numbers: Numbers, sign: Literal[1, -1]) -> Numbers:
    """One row: the rise from the first to the last, or the drop."""

    def find(evidence: Witness, methods: Sequence[str]) -> list[Row]:
        rows = numbers.find(evidence, methods)
        if len(rows) < 2:
            raise NotTestableError(_ONE_LEVEL)
        return [Row(f"{rows[0].label} to {rows[-1].label}", (rows[-1].scores - rows[0].scores) * sign)]

    what = f"{'rise' if sign > 0 else 'drop'} of {numbers.what}"
    where = "from the first to the last, " + numbers.where.replace("at each", "over each", 1)
    return replace(numbers, what=what, find=find, where=where, superlative="largest")


def everywhere(column: str, methods: Sequence[str], *needed: Source, without: str) -> Numbers:
    """Make a row for each level of all experiments but one; some have to be there."""

    def find(evidence: Witness, _: Sequence[str]) -> list[Row]:
        _need(evidence, needed, methods)
        rows: list[Row] = []
        for experiment in EXPERIMENTS.values():
            for place in experiment.places:
                sample = evidence.all.sample(experiment.id, place)
                if sample is not None and experiment.id != without:
                    table = sample.by_level(column).reindex(columns=list(methods))
                    rows += [Row(f"{place}, {name_level(sample, at)}", table.loc[at]) for at in table.index]
        return rows

    kind = needed[0].experiment
    places = _join(source.place for source in needed)
    where = f"at each level of each experiment but '{without}'; needs '{kind}' on {places}"
    return Numbers(_WHAT[column], where, find)


def same_cases(column: str, methods: tuple[str, ...], *places: str) -> Numbers:
    """Make a row for each place: means over the cases that all of some methods were run on."""

    def find(evidence: Witness, _: Sequence[str]) -> list[Row]:
        return [Row(place, evidence.need_same_cases(place, methods).overall(column)) for place in places]

    return Numbers(_WHAT[column], f"on the same cases of {_join(places)}", find)


def times(superlative: Literal["longest", "shortest"], *, largest: int = 0) -> Numbers:
    """Logarithms of the mean times: a row for each n, or for the largest, which has to reach a size."""
    sign = 1.0 if superlative == "longest" else -1.0

    def find(evidence: Witness, methods: Sequence[str]) -> list[Row]:
        logs = sign * np.log(evidence.need_times(*methods))
        if logs.index[-1] < largest:
            message = f"no times for n of {largest} or more"
            raise NotTestableError(message)
        return [Row(f"n {n}", row) for n, row in (logs.tail(1) if largest else logs).iterrows()]

    where = f"at the largest n, which has to be {largest} or more" if largest else "at each n"
    return Numbers(
        "time", where, find, show=lambda value: show_time(sign * value), tie=TIME_TIE, superlative=superlative
    )


# --- What they are made of ----------------------------------------------------------------------------------

_OPERATORS: dict[str, Callable[..., bool]] = {
    ">": lambda value, bound: value > bound,
    ">=": lambda value, bound: value >= bound - 1e-12,  # up to rounding
    "<": lambda value, bound: value < bound,
    "<=": lambda value, bound: value <= bound + 1e-12,
}


def compare(label: str, value: float, operator: Operator, bound: float) -> Comparison:
    """Compare a score with a bound."""
    margin = value - bound if operator[0] == ">" else bound - value
    return Comparison(bool(_OPERATORS[operator](value, bound)), f"{label} {show_score(value)}", float(margin))


def expect_in_top(row: Row, method: str, k: int, numbers: Numbers) -> Comparison:
    """Fewer than k others have a score that is higher by more than a tie."""
    scores = row.scores
    values = scores.to_numpy(dtype=np.float64)
    is_rival = (scores.index != method) & ~np.isnan(values)
    if is_rival.sum() < k:
        message = f"fewer than {k + 1} methods to rank"
        raise NotTestableError(message)
    at = np.flatnonzero(is_rival)[np.argsort(-values[is_rival], kind="stable")[k - 1]]
    rival, own, value = _name(str(scores.index[at])), float(scores[method]), float(values[at])
    nth = _NTH.get(k, f"number {k} of the others")
    text = f"{_name(method)} {numbers.show(own)}, {nth} {rival} {numbers.show(value)}"
    return Comparison(own - value >= -numbers.tie, f"{row.label}, {numbers.what}: {text}", own - value)


def rank(scores: pd.Series, method: str) -> int:
    """1 + number of methods that are better by more than a tie."""
    return 1 + int((scores > scores[method] + TIE).sum())


def correlate_with_levels(at: Iterable[float], values: Iterable[float]) -> float:
    """Spearman's rank correlation of values with levels; 0 for constant values, NaN under three levels."""
    x, y = np.fromiter(at, dtype=np.float64), np.fromiter(values, dtype=np.float64)
    known = ~np.isnan(y)
    if known.sum() < 3:
        return math.nan
    if np.ptp(y[known]) == 0:
        return 0.0
    found: Any = stats.spearmanr(x[known], y[known])
    return float(found.statistic)


def compare_rankings(one: pd.Series, other: pd.Series) -> float:
    """Kendall's tau-b between two rankings of the methods; 1 where both are ties throughout."""
    orders = [np.sign(np.subtract.outer(scores, scores)) for scores in (one.to_numpy(), other.to_numpy())]
    ordered = [float((order**2).sum()) for order in orders]
    if ordered == [0.0, 0.0]:
        return 1.0
    norm = math.sqrt(ordered[0] * ordered[1])
    tau = float((orders[0] * orders[1]).sum()) / norm if norm else 0.0
    return 0.0 if math.isnan(tau) else tau


def show_score(value: float) -> str:
    """Write a score."""
    return f"{value:.3f}" if abs(value) < 0.1 else f"{value:.2f}"


def show_time(log_seconds: float) -> str:
    """Write a time that is given by its logarithm."""
    seconds = math.exp(log_seconds)
    return f"{seconds:.3g} s" if seconds >= 1 else f"{1e3 * seconds:.3g} ms"


def name_level(sample: Sample, level: Level) -> str:
    """Name a level of an experiment."""
    text = level if isinstance(level, str) else f"{level:g}"
    experiment = sample.experiment.id
    return _LEVELS.get(experiment, (experiment + " {}", ""))[0].format(text)


def _pick(words: str, wanted: Callable[[float], bool]) -> Pick:
    def choose(known: Sequence[Level]) -> list[Level]:
        chosen = [level for level in known if wanted(round(float(level), 6))]
        if not chosen:
            message = f"the records hold no level {words}"
            raise NotTestableError(message)
        return chosen

    return Pick(words, choose)


def _need(evidence: Witness, sources: Iterable[Source], methods: Sequence[str]) -> list[Sample]:
    return [evidence.need(source, *methods) for source in sources]


def _stack(rows: Sequence[Row]) -> pd.DataFrame:
    return pd.DataFrame([row.scores for row in rows])


def _choose(row: Row, methods: Sequence[str]) -> list[tuple[str, float]]:
    """Methods that are named, or all, each with its number."""
    return [(str(method), float(row.scores[method])) for method in methods or row.scores.index]


def _missing(methods: Iterable[str], there: Iterable[str]) -> str:
    known = set(there)
    return ", ".join(_name(each) for each in methods if each not in known)


def _name(method: str) -> str:
    """Name a method as the paper does; what isn't one, in its own words."""
    return method if " " in method else method.upper()


def _names(methods: Iterable[str]) -> str:
    return _join(map(_name, methods))


def _join(names: Iterable[str]) -> str:
    known = list(dict.fromkeys(names))
    return " and ".join((", ".join(known[:-1]), known[-1])) if len(known) > 1 else "".join(known)


def _level_noun(source: Source) -> str:
    return _LEVELS.get(source.experiment, ("", f"level of {source.experiment}"))[1]


def _at(sources: Sequence[Source], pick: Pick | None) -> str:
    what = " and each ".join(_level_noun(source) for source in sources)
    picked = f" {pick.words}" if pick else ""
    return f"at each {what}{picked} on {_join(source.place for source in sources)}"
