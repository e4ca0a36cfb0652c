"""Choices among the levels of an experiment."""

from __future__ import annotations

import operator as operators
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

from cgroup.benchmark.paper.evidence import Level
from cgroup.benchmark.paper.table import NotTestableError

COMBINATIONS = ("C1", "C2", "C3", "C4", "C5", "C6")
"""Of detector and descriptor, as the paper numbers them."""

_SIDES = {
    "<": (operators.lt, "below"),
    "<=": (operators.le, "at or below"),
    ">": (operators.gt, "above"),
    ">=": (operators.ge, "from"),
}


class Pick(NamedTuple):
    """Some of the levels: in words, and a function that chooses among the known ones."""

    words: str
    choose: Callable[[Sequence[Level]], list[Level]]


def at(operator: Literal["<", "<=", ">", ">="], bound: float) -> Pick:
    """Levels on one side of a bound, at least one of which must be there."""
    compare, words = _SIDES[operator]

    def choose(known: Sequence[Level]) -> list[Level]:
        chosen = [level for level in known if compare(round(float(level), 6), bound)]
        if not chosen:
            message = f"the records hold no level {words} {bound:g}"
            raise NotTestableError(message)
        return chosen

    return Pick(f"{words} {bound:g}", choose)


def named(*wanted: Level) -> Pick:
    """Levels that a statement names, all of which must be there."""

    def choose(known: Sequence[Level]) -> list[Level]:
        missing = [str(each) for each in wanted if each not in known]
        if missing:
            message = "the records lack the level " + ", ".join(missing)
            raise NotTestableError(message)
        return list(wanted)

    return Pick("of the six" if wanted == COMBINATIONS else "of " + " and ".join(map(str, wanted)), choose)


def nearest(level: float, low: float, high: float, *, optional: bool = False) -> Pick:
    """Level nearest to one, within bounds; it must be there unless it is optional."""

    def choose(known: Sequence[Level]) -> list[Level]:
        within = [each for each in known if low <= round(float(each), 6) <= high]
        if not within and not optional:
            message = f"the records hold no level around {level:g}"
            raise NotTestableError(message)
        return sorted(within, key=lambda each: abs(float(each) - level))[:1]

    within = f"within {low:g} to {high:g}{', if there is one' if optional else ''}"
    return Pick(f"nearest to {level:g} ({within})", choose)
