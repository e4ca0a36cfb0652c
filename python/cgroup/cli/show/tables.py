"""Tables as wide as the terminal, 80 columns where there is none: whole columns go, rows never wrap."""

from __future__ import annotations

from dataclasses import dataclass
from io import StringIO
from typing import TYPE_CHECKING

from cgroup._checks.quoting import escape
from cgroup.cli.show.colors import wants_colors
from cgroup.cli.show.terminal import print_line, print_prose, print_text, terminal_width

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

_GAP = 2
_LEAST_TEXT = 12
"""Width that a column of text keeps, at least."""


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes
    ----------
    header : str
        Its heading.
    is_text : bool
        Whether it holds words, which begin at the left and may be cut; numbers end at the right.
    priority : int
        0 stays; of the others, those with the highest number go first where the width doesn't suffice.
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
    """Print a table, and say what was left out of it.

    Parameters
    ----------
    columns : sequence of Column
        In order.
    rows : sequence of sequences of str
        One text per column.
    best : collection of (row, column)
        Cells that stand out, on a terminal.
    wide : bool
        Whether all is shown, however wide that is.
    """
    from rich.cells import cell_len  # noqa: PLC0415 - slow to load

    cells = [[escape(cell) for cell in row] for row in rows]
    widths = [
        max(cell_len(column.header), *(cell_len(row[at]) for row in cells), 0)
        for at, column in enumerate(columns)
    ]
    shown, is_cut = (list(range(len(columns))), False) if wide else _fit(columns, widths, terminal_width())
    print_text(_render(columns, cells, shown, widths, best))
    left_out = [column.header for at, column in enumerate(columns) if at not in shown]
    if left_out:
        print_prose(f"Left out: {', '.join(left_out)}. --wide shows all.")
    elif is_cut:
        print_line("Cut to fit; --wide shows all.")


def _fit(columns: Sequence[Column], widths: list[int], room: int) -> tuple[list[int], bool]:
    """Choose the columns that fit, narrow those of text in place; return them, and whether any is."""
    shown = list(range(len(columns)))
    while _needed(widths, shown) > room:
        droppable = [at for at in shown if columns[at].priority]
        if not droppable:
            break
        shown.remove(max(droppable, key=lambda at: (columns[at].priority, at)))
    too_much = _needed(widths, shown) - room
    is_cut = too_much > 0
    for at in sorted((at for at in shown if columns[at].is_text), key=lambda at: -widths[at]):
        if too_much <= 0:
            break
        narrower = min(widths[at], max(_LEAST_TEXT, widths[at] - too_much))
        too_much -= widths[at] - narrower
        widths[at] = narrower
    return shown, is_cut


def _needed(widths: list[int], shown: list[int]) -> int:
    return sum(widths[at] for at in shown) + _GAP * (len(shown) - 1)


def _render(
    columns: Sequence[Column],
    cells: list[list[str]],
    shown: list[int],
    widths: list[int],
    best: Collection[tuple[int, int]],
) -> str:
    from rich.console import Console  # noqa: PLC0415 - slow to load
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    table = Table(box=None, pad_edge=False, padding=(0, _GAP, 0, 0), header_style="bold")
    for at in shown:
        justify = "left" if columns[at].is_text else "right"
        table.add_column(
            Text(columns[at].header), justify=justify, width=widths[at], no_wrap=True, overflow="ellipsis"
        )
    for number, row in enumerate(cells):
        styles = ["bold green" if (number, at) in best else "" for at in shown]
        table.add_row(
            *(Text(_cut(row[at], widths[at]), style) for at, style in zip(shown, styles, strict=True))
        )
    text = StringIO()
    colors = wants_colors()
    Console(
        file=text,
        width=max(1, _needed(widths, shown)) + _GAP,
        force_terminal=colors,
        color_system="standard" if colors else None,
        legacy_windows=False,
    ).print(table)
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines())


def _cut(text: str, width: int) -> str:
    """Return the beginning of a text that is too wide; its end in plain dots, which every output has."""
    from rich.cells import cell_len  # noqa: PLC0415 - slow to load

    if cell_len(text) <= width:
        return text
    while cell_len(text) > width - 3:
        text = text[:-1]
    return text + "..."
