"""Tests of numbers that make up the claims, each with its criterion in words; combined by ``&``."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from cgroup.benchmark.paper.numbers import TIE, Numbers, Row, join, join_names, name, show_score
from cgroup.benchmark.paper.table import NotTestableError, Witness

Operator: TypeAlias = Literal[">", ">=", "<", "<="]

_ROUNDING = -1e-12  # least margin of numbers that are equal up to rounding
_HOW_MANY = {1: "", 2: "two ", 3: "three ", 4: "four "}
_NTH = {1: "best other", 2: "second of the others", 3: "third of the others"}


class Comparison(NamedTuple):
    """Result of a comparison with a claim, in words, and the margin; NaN if a number is missing."""

    holds: bool
    text: str
    margin: float


@dataclass(frozen=True)
class Check:
    """Tests of the table, their criterion in words, and whether all or most must hold."""

    criterion: str
    find: Callable[[Witness], Sequence[Comparison]]
    need: Literal["all", "most"] = "all"

    def __and__(self, other: "Check") -> "Check":
        return Check(
            f"{self.criterion}; {other.criterion}",
            lambda witness: [*self.find(witness), *other.find(witness)],
            self.need,
        )


def most(check: Check) -> Check:
    """Require that more than half of the tests hold."""
    return replace(check, criterion=f"in more than half of the cases: {check.criterion}", need="most")


def share(operator: Operator, bound: float, check: Check) -> Check:
    """Compare the fraction of tests that hold with a bound; this is one test."""

    def find(witness: Witness) -> list[Comparison]:
        holding = [test.holds for test in check.find(witness)]
        label = f"{check.criterion}: {sum(holding)} of {len(holding)}, share"
        return [compare(label, float(np.mean(holding)), operator, bound)]

    return Check(f"share {operator} {bound:g} of the cases in which {check.criterion}", find)


def bound(numbers: Numbers, operator: Operator, value: float, methods: Sequence[str] = ()) -> Check:
    """Compare each number of some methods, or of all, with a bound."""
    limit = numbers.show(value) if numbers.what == "time" else f"{value:g}"
    return _of_each_number(
        f"{operator} {limit}",
        numbers,
        methods,
        lambda label, number: compare(label, number, operator, value, numbers.show),
        tuple(methods),
    )


def between(low: float, high: float, numbers: Numbers, methods: Sequence[str] = ()) -> Check:
    """Require that each number of some methods, or of all, is between bounds."""
    return _of_each_number(
        f"between {low:g} and {high:g}",
        numbers,
        methods,
        lambda label, number: Comparison(
            low - 1e-12 <= number <= high + 1e-12,
            f"{label} {numbers.show(number)}",
            min(number - low, high - number),
        ),
    )


def in_top(tops: Mapping[str, int], numbers: Numbers) -> Check:
    """Require that each method is among its best k; ties count."""
    words = [
        f"{join_names(method for method in tops if tops[method] == k)} "
        f"{'among ' if k > 1 else ''}the {_HOW_MANY[k]}{numbers.superlative}"
        for k in dict.fromkeys(tops.values())
    ]
    return _at_each(
        f"{numbers.what} of {', of '.join(words)}",
        numbers,
        lambda row: [expect_in_top(row, method, k, numbers) for method, k in tops.items()],
    )


def higher(one: str, others: Sequence[str], numbers: Numbers, *, twice: bool = False) -> Check:
    """Require that a number exceeds those of others by more than a tie; or a time, by a factor of two."""
    by, than = (math.log(2), "more than twice") if twice else (numbers.tie, "higher than")

    def test(row: Row) -> list[Comparison]:
        pairs = [(row.scores[one] - row.scores[other] - by, (one, other)) for other in others]
        return [
            Comparison(
                bool(margin > 0),
                f"{row.label}, {numbers.what}: "
                + ", ".join(f"{name(each)} {numbers.show(row.scores[each])}" for each in pair),
                float(margin),
            )
            for margin, pair in pairs
        ]

    words = f"{numbers.what} of {name(one)} {than} that of {join_names(others)}"
    return _at_each(words, numbers, test, (one, *others))


def higher_mean(ones: Sequence[str], others: Sequence[str], numbers: Numbers) -> Check:
    """Require that the mean of some methods exceeds that of others by more than a tie."""

    def test(row: Row) -> list[Comparison]:
        means = [float(row.scores[list(each)].mean()) for each in (ones, others)]
        pair = join(
            f"{show_score(mean)} ({join_names(group)})"
            for mean, group in zip(means, (ones, others), strict=True)
        )
        margin = means[0] - means[1] - TIE
        return [Comparison(margin > 0, f"{row.label}: mean {numbers.what} {pair}", margin)]

    words = f"mean {numbers.what} of {join_names(ones)} higher than that of {join_names(others)}"
    return _at_each(words, numbers, test)


def best_with(wanted: Sequence[str], numbers: Numbers, methods: Sequence[str] = ()) -> Check:
    """Require that the highest number of each method is at one of some levels; ties count as highest."""
    these = " or ".join(wanted)

    def find(witness: Witness) -> list[Comparison]:
        rows = numbers.find(witness, ())
        tests: list[Comparison] = []
        for method in methods or rows[0].scores.index:
            known = {str(row.level): float(row.scores[method]) for row in rows}
            known = {level: value for level, value in known.items() if not math.isnan(value)}
            others = [level for level in known if level not in wanted]
            if others:
                here = max((known[level] for level in wanted if level in known), default=math.nan)
                best = max(others, key=known.__getitem__)
                text = f"{show_score(here)} with {these}, {show_score(known[best])} with {best}"
                text = f"{numbers.what} of {name(method)} {text}"
                tests.append(Comparison(here >= known[best] - TIE, text, here - known[best]))
        return tests

    whose = join_names(methods) if methods else numbers.whose
    return Check(
        f"{numbers.what} of {whose} best with {these}, {numbers.where.replace('at each', 'over each', 1)}",
        find,
    )


def compare(
    label: str, value: float, operator: Operator, limit: float, show: Callable[[float], str] = show_score
) -> Comparison:
    """Compare a number with a bound."""
    margin = float(value - limit if operator[0] == ">" else limit - value)
    holds = margin > 0 if operator in {"<", ">"} else margin >= _ROUNDING
    return Comparison(holds, f"{label} {show(value)}", margin)


def expect_in_top(row: Row, method: str, k: int, numbers: Numbers) -> Comparison:
    """Test that fewer than k other methods are better by more than a tie."""
    scores = row.scores
    values = scores.to_numpy(dtype=np.float64)
    is_rival = (scores.index != method) & ~np.isnan(values)
    if is_rival.sum() < k:
        raise NotTestableError(f"fewer than {k + 1} methods to rank")
    at = np.flatnonzero(is_rival)[np.argsort(-values[is_rival], kind="stable")[k - 1]]
    rival, own, value = name(str(scores.index[at])), float(scores[method]), float(values[at])
    nth = _NTH.get(k, f"number {k} of the others")
    text = f"{name(method)} {numbers.show(own)}, {nth} {rival} {numbers.show(value)}"
    return Comparison(own - value >= -numbers.tie, f"{row.label}, {numbers.what}: {text}", own - value)


def _at_each(
    words: str, numbers: Numbers, test: Callable[[Row], list[Comparison]], methods: tuple[str, ...] = ()
) -> Check:
    """Test each row."""
    return Check(
        f"{words} {numbers.where}",
        lambda witness: [found for row in numbers.find(witness, methods) for found in test(row)],
    )


def _of_each_number(
    words: str,
    numbers: Numbers,
    methods: Sequence[str],
    test: Callable[[str, float], Comparison],
    needed: tuple[str, ...] = (),
) -> Check:
    """Test each number of some methods, or of all."""

    def of_row(row: Row) -> list[Comparison]:
        scores = row.scores[list(methods)] if methods else row.scores
        return [
            test(f"{row.label}, {numbers.what} of {name(str(method))}", float(number))
            for method, number in scores.items()
        ]

    whose = join_names(methods) if methods else numbers.whose
    return _at_each(f"{numbers.what} of {whose} {words}", numbers, of_row, needed)
