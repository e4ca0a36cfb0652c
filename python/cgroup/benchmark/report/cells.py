"""Tables as plain cells for the template."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

from cgroup.plots.style import METHOD_STYLES, method_style

MISSING = "-"
"""Stands in cells without a value."""

_DIGITS = "0123456789.,-+e/% "


class Cell(NamedTuple):
    """One cell.

    Attributes
    ----------
    text : str
        What is shown.
    key : float or str
        What the column is sorted by.
    best : bool
        Whether it is the best of its column, or as good.
    interval : tuple of float, optional
        A mean between 0 and 1, and the ends of its interval, drawn as a bar.
    """

    text: str
    key: float | str
    best: bool = False
    interval: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Table:
    """A table that can be sorted.

    Attributes
    ----------
    caption : str
        Shown above it.
    headers : tuple of str
        One per column.
    rows : list of tuple of Cell
        In the order in which they are shown first.
    """

    caption: str
    headers: tuple[str, ...]
    rows: list[tuple[Cell, ...]]

    @property
    def numeric(self) -> list[bool]:
        """Whether each column is sorted by numbers."""
        return [any(not isinstance(cell.key, str) for cell in column) for column in self._columns()]

    @property
    def right(self) -> list[bool]:
        """Whether each column shows numbers, and is set flush right."""
        shown = (all(not cell.text.strip(_DIGITS) for cell in column) for column in self._columns())
        return [digits and by_number for digits, by_number in zip(shown, self.numeric, strict=True)]

    @property
    def descending(self) -> list[bool]:
        """Whether the first click on each column shows the largest first: numbers, but no ranks or p."""
        return [
            number and header not in {"rank", "p"}
            for number, header in zip(self.numeric, self.headers, strict=True)
        ]

    def _columns(self) -> list[tuple[Cell, ...]]:
        return list(zip(*self.rows, strict=True)) if self.rows else [()] * len(self.headers)


def number(value: float | None, text: str = "{:.3f}") -> Cell:
    """Cell of a number; a dash for NaN, sorted last."""
    if value is None or math.isnan(value):
        return Cell(MISSING, -math.inf)
    return Cell(text.format(value), float(value))


def words(text: object) -> Cell:
    """Cell of a text."""
    return Cell(str(text), str(text))


def method_cell(method: str) -> Cell:
    """Cell of a method, sorted in the paper's order."""
    known = list(METHOD_STYLES)
    order = known.index(method) if method in known else len(known)
    return Cell(method_style(method).label, float(order))
