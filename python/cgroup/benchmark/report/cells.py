"""Tables of the report: cells, and rows from groups of records and columns of numbers."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import pandas as pd

from cgroup.plots.style import METHOD_STYLES, method_style

MISSING = "-"  # text of cells without a value
_DIGITS = "0123456789.,-+e/% "


class Cell(NamedTuple):
    """A cell: its text, the number or text that sorts it, and whether it is among the best of its column.

    `interval` is a mean between 0 and 1 and the ends of its interval, drawn as a bar.
    """

    text: str
    key: float | str
    best: bool = False
    interval: tuple[float, float, float] | None = None


@dataclass(frozen=True)
class Table:
    """A table that can be sorted: caption, a header per column, and rows in the order shown first."""

    caption: str
    headers: tuple[str, ...]
    rows: list[tuple[Cell, ...]]

    @property
    def numeric(self) -> list[bool]:
        """For each column, whether it is sorted by numbers."""
        return [any(not isinstance(cell.key, str) for cell in column) for column in self._columns()]

    @property
    def right(self) -> list[bool]:
        """For each column, whether it shows right-aligned numbers."""
        shown = (all(not cell.text.strip(_DIGITS) for cell in column) for column in self._columns())
        return [digits and by_number for digits, by_number in zip(shown, self.numeric, strict=True)]

    def _columns(self) -> list[tuple[Cell, ...]]:
        return list(zip(*self.rows, strict=True)) if self.rows else [()] * len(self.headers)


def number(value: float | None, text: str = "{:.3f}") -> Cell:
    """Return a cell of a number; a dash for NaN, sorted last."""
    if value is None or math.isnan(value):
        return Cell(MISSING, -math.inf)
    return Cell(text.format(value), float(value))


def words(text: object) -> Cell:
    """Return a cell of a text."""
    return Cell(str(text), str(text))


def method_cell(method: str) -> Cell:
    """Return a cell of a method, sorted in the paper's order."""
    known = list(METHOD_STYLES)
    order = known.index(method) if method in known else len(known)
    return Cell(method_style(method).label, float(order))


# Headers, and functions from the rows of one group to a cell
Columns = Mapping[str, Callable[[pd.DataFrame], Cell]]


def tabulate(
    caption: str,
    frame: pd.DataFrame,
    by: Mapping[str, str],
    columns: Columns,
    *,
    name: Callable[[str], Cell] = words,
    best: bool = False,
) -> Table:
    """Make a table with one row per group of rows.

    `by` has a header for each column that the rows are grouped by. `name` makes the cell of the last one.
    `best` marks the largest number of each column.
    """
    lines: list[tuple[Cell, ...]] = []
    for key, rows in frame.groupby(list(by), sort=False):
        *others, last = key
        cells = [make(rows) for make in columns.values()]
        lines.append((*map(words, others), name(str(last)), *cells))
    if best:
        most = [max(cell.key for cell in column) for column in zip(*lines, strict=True)]
        lines = [
            tuple(cell._replace(best=at >= len(by) and cell.key == most[at]) for at, cell in enumerate(line))
            for line in lines
        ]
    return Table(caption, (*by.values(), *columns), lines)


def mean(column: str, text: str = "{:.3f}") -> Callable[[pd.DataFrame], Cell]:
    """Return a function that makes the cell of a mean."""
    return lambda rows: number(float(rows[column].mean()), text)


def median(column: str, text: str, scale: float = 1.0) -> Callable[[pd.DataFrame], Cell]:
    """Return a function that makes the cell of a scaled median."""
    return lambda rows: number(scale * float(rows[column].median()), text)


def share(flags: pd.Series) -> Cell:
    """Return a cell "k of n" for flags."""
    if flags.empty:
        return Cell(MISSING, -1.0)
    return Cell(f"{int(flags.sum())} of {len(flags)}", float(flags.mean()))


def milliseconds(seconds: float) -> Cell:
    """Return a cell of milliseconds."""
    value = 1e3 * seconds
    return number(value, "{:,.0f}" if value >= 100 else "{:.3g}")


def dataset_table(frame: pd.DataFrame, known: pd.DataFrame) -> Table:
    """Tabulate the data sets of the experiments."""
    about = known.set_index("name").to_dict("index")

    def fact(rows: pd.DataFrame, name: str) -> Cell:
        return words(about.get(rows["dataset"].iloc[0], {}).get(name, MISSING))

    def origins(rows: pd.DataFrame) -> Cell:
        counts = rows.drop_duplicates("pair").groupby("origin").size()
        return words(", ".join(f"{origin} ({count})" for origin, count in counts.items()))

    columns = {
        "data set": lambda rows: fact(rows, "title"),
        "role": lambda rows: fact(rows, "role"),
        "origin (pairs)": origins,
        "pairs": lambda rows: number(rows["pair"].nunique(), "{:.0f}"),
        "cases": lambda rows: number(rows["case"].nunique(), "{:.0f}"),
        "mean matches": lambda rows: number(rows.drop_duplicates("case")["n"].mean(), "{:.0f}"),
        "citation": lambda rows: fact(rows, "citation"),
    }
    return tabulate("Data sets", frame, {"dataset": "name"}, columns)


def failure_table(frames: Iterable[pd.DataFrame]) -> Table:
    """Tabulate errors."""
    columns = {
        "methods or solvers": lambda rows: words(
            ", ".join(method_style(name).label for name in rows["method"].unique())
        ),
        "cases": lambda rows: number(rows["case"].nunique(), "{:.0f}"),
        "for example": lambda rows: words(rows["pair"].iloc[0]),
    }
    by = {"dataset": "data set", "error": "error"}
    failed = [each[each["error"] != ""] for each in frames if len(each)]
    found = [tabulate("Failures", each, by, columns) for each in failed]
    return Table("Failures", (*by.values(), *columns), [row for each in found for row in each.rows])


def plain_table(caption: str, frame: pd.DataFrame) -> Table:
    """Tabulate a frame unchanged."""
    rows = [tuple(words(value) for value in row) for row in frame.itertuples(index=False)]
    return Table(caption, tuple(map(str, frame.columns)), rows)
