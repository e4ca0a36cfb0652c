"""Changes of records, to see what a claim makes of them: which number, to what, in which rows."""

from collections.abc import Callable
from typing import TypeAlias

import pandas as pd

from cgroup.registry import PAPER_METHODS

Change: TypeAlias = Callable[[pd.DataFrame], pd.DataFrame]
Number: TypeAlias = "float | Callable[[pd.DataFrame], pd.Series]"

# Any order of the nine would do; the claim about thresholds needs GC and GTM third and fourth.
ORDER = ("ss", "nnsr", "si", "cv", "3dhv", "gc", "gtm", "ransac", "st")
NO_TIE = 0.011  # just more than the claims take for a tie


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


def put_behind(
    column: str, methods: str | tuple[str, ...], k: int, by: str = "dataset", **where: object
) -> Change:
    """Set the mean score of some methods so that, at each level, just k others are better."""
    return _put_after(column, methods, lambda others: others.nlargest(k).iloc[-1] - NO_TIE, by, where)


def put_faster(methods: str | tuple[str, ...], k: int) -> Change:
    """Set the times of some methods so that, at each n, just k others are slower."""
    return _put_after("seconds", methods, lambda others: others.nlargest(k).iloc[-1] / 1.06, "n", {})


def put_slower(methods: str | tuple[str, ...], k: int) -> Change:
    """Set the times of some methods so that, at each n, just k others are faster."""
    return _put_after("seconds", methods, lambda others: others.nsmallest(k).iloc[-1] * 1.06, "n", {})


def _put_after(
    column: str,
    methods: str | tuple[str, ...],
    choose: Callable[[pd.Series], float],
    by: str,
    where: dict[str, object],
) -> Change:
    """Set what is chosen by the means of the other methods, at each level."""

    def change(frame: pd.DataFrame) -> pd.DataFrame:
        frame = frame.astype({column: float})
        chosen = pick(frame, **where) & frame["method"].isin(PAPER_METHODS)
        own = pick(frame, method=methods)
        means = frame[chosen & ~own].pivot_table(index=by, columns="method", values=column)
        number = frame[by].map(means.apply(choose, axis=1))
        return frame.assign(**{column: frame[column].where(~(chosen & own), number)})

    return change


def reorder(level: str, *sizes: int) -> Callable[[pd.DataFrame], pd.Series]:
    """Scores in `ORDER` at one level; at the next, each block of so many neighbours is turned around."""
    turned: list[str] = []
    for size in sizes:
        start = len(turned)
        turned += reversed(ORDER[start : start + size])

    def score(frame: pd.DataFrame) -> pd.Series:
        at_odd, at_even = (frame["method"].map({m: k / 10 for k, m in enumerate(o)}) for o in (ORDER, turned))
        return at_odd.where(frame[level].rank(method="dense") % 2 == 1, at_even)

    return score
