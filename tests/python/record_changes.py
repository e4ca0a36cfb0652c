"""Changes of records, to see what a claim makes of them: which number, to what, in which rows."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import pandas as pd

Change: TypeAlias = Callable[[pd.DataFrame], pd.DataFrame]
Number: TypeAlias = "float | Callable[[pd.DataFrame], pd.Series]"

# GC and GTM in the middle: neither this order nor the opposite one has them at the top.
MIXED_ORDER = ("ss", "nnsr", "ransac", "gtm", "gc", "3dhv", "st", "si", "cv")


def put(column: str, number: Number, **where: object) -> Change:
    """Set a number, or what a function makes of the rows, in the rows that `pick` finds."""

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        value = number(frame) if callable(number) else number
        return frame.assign(**{column: frame[column].where(~pick(frame, **where), value)})

    return change


def add(column: str, amount: float, **where: object) -> Change:
    """Add to a number in the rows that `pick` finds."""
    return put(column, lambda frame: frame[column] + amount, **where)


def pick(frame: pd.DataFrame, experiment: str = "", **where: object) -> pd.Series:
    """Rows of an experiment in which columns have a value, one of several, or one that a function accepts."""
    chosen = pd.Series(data=True, index=frame.index)
    if experiment:
        chosen &= frame["experiments"].map(lambda ids: experiment in ids)
    for column, wanted in where.items():
        if callable(wanted):
            chosen &= frame[column].map(wanted)
        else:
            chosen &= frame[column].isin(wanted if isinstance(wanted, tuple) else (wanted,))
    return chosen


def below(bound: float) -> Callable[[float], bool]:
    return lambda value: value < bound


def above(bound: float) -> Callable[[float], bool]:
    return lambda value: value > bound


def but(*values: str) -> Callable[[str], bool]:
    return lambda value: value not in values


def turn_around(level: str) -> Callable[[pd.DataFrame], pd.Series]:
    """Scores in `MIXED_ORDER` at one level, and in the opposite order at the next."""

    def score(frame: pd.DataFrame) -> pd.Series:
        order = frame["method"].map(dict(zip(MIXED_ORDER, range(9), strict=True)))
        odd = frame[level].rank(method="dense") % 2 == 1
        return order.where(odd, 8 - order) / 10

    return score
