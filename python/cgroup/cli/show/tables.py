"""Tables that fit the terminal: whole columns are dropped, rows never wrap."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cgroup._checks.quoting import escape
from cgroup.cli.show.terminal import paint, print_line, print_prose, print_text, terminal_width

UNKNOWN = "-"
"""Cell of an unknown value."""

_GAP = 2
_LEAST_TEXT = 12
"""Least width of a column of text."""


@dataclass(frozen=True)
class Column:
    """A column: text is left-aligned and may be cut, numbers are right-aligned.

    If the width doesn't suffice, columns of the highest `priority` are dropped first; those of 0 stay.
    """

    header: str
    is_text: bool = False
    priority: int = 0


def print_table(
    columns: Sequence[Column],
    rows: Sequence[Sequence[str]],
    *,
    best: Collection[tuple[int, int]] = (),
    wide: bool = False,
) -> None:
    """Print a table, and name the dropped columns; the best cells, (row, column), are highlighted."""
    from rich.cells import cell_len  # noqa: PLC0415 - slow to load

    columns = [replace(column, header=escape(column.header)) for column in columns]
    cells = [[escape(cell) for cell in row] for row in rows]
    widths = [
        max(cell_len(column.header), *(cell_len(row[at]) for row in cells), 0)
        for at, column in enumerate(columns)
    ]
    shown, is_cut = (list(range(len(columns))), False) if wide else _fit(columns, widths, terminal_width())
    lines = [[_pad(columns[at].header, columns[at], widths[at], bold=True) for at in shown]]
    for number, row in enumerate(cells):
        styles = {at: {"bold": True, "fg": "green"} if (number, at) in best else {} for at in shown}
        lines.append([_pad(row[at], columns[at], widths[at], **styles[at]) for at in shown])
    print_text("\n".join((" " * _GAP).join(line).rstrip() for line in lines))
    left_out = [column.header for at, column in enumerate(columns) if at not in shown]
    if left_out:
        print_prose(f"Left out: {', '.join(left_out)}. --wide shows all.")
    elif is_cut:
        print_line("Cut to fit; --wide shows all.")


def _fit(columns: Sequence[Column], widths: list[int], room: int) -> tuple[list[int], bool]:
    """Choose columns that fit, and narrow text columns in place; return them, and whether any is cut."""
    shown = list(range(len(columns)))

    def excess() -> int:
        return sum(widths[at] + _GAP for at in shown) - _GAP - room

    droppable = [at for at in sorted(shown, key=lambda at: columns[at].priority) if columns[at].priority]
    while excess() > 0 and droppable:
        shown.remove(droppable.pop())
    is_cut = excess() > 0
    for at in sorted((at for at in shown if columns[at].is_text), key=lambda at: -widths[at]):
        widths[at] = min(widths[at], max(_LEAST_TEXT, widths[at] - max(excess(), 0)))
    return shown, is_cut


def _pad(text: str, column: Column, width: int, **style: object) -> str:
    """Return a cell of a given width; the end of a longer text becomes three dots."""
    from rich.cells import cell_len, set_cell_size  # noqa: PLC0415 - slow to load

    if cell_len(text) > width:
        text = set_cell_size(text, width - 3) + "..."
    space = " " * (width - cell_len(text))
    painted = paint(text, **style) if style else text
    return painted + space if column.is_text else space + painted


def show_value(value: object, form: str = ".3g") -> str:
    """Return a value of a document as text; `form` is for floats."""
    if value is None:
        return UNKNOWN
    if isinstance(value, bool):
        return "yes" if value else "no"
    return format(value, form) if isinstance(value, float) else str(value)


def show_length(value: float | None, digits: int = 3) -> str:
    """Return a length with so many digits, without an exponent."""
    if value is None:
        return UNKNOWN
    return np.format_float_positional(value, precision=digits, unique=False, fractional=False, trim="-")
