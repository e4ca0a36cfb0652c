"""Print lines, facts, poses and tables, in colours if supported; show progress; write pictures."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Collection, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from threading import Lock
from time import monotonic
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from cgroup import io
from cgroup._checks.quoting import escape
from cgroup._runtime.progress import ignore_progress
from cgroup._show.words import pose_lines
from cgroup.cli.process import write_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.progress import Progress

UNKNOWN = "-"  # cell of an unknown value
_GAP = 2  # between columns
_LEAST_TEXT = 12  # width of a column of text
_NAMES_WIDTH = 12  # of names of facts
_SILENT = 15.0  # seconds between lines of progress


def paint(text: str, **style: Any) -> str:
    """Return a text in a style of `typer.style`, or unchanged without colours."""
    return typer.style(text, **style) if wants_colors() else text


def wants_colors() -> bool:
    """Whether standard output is a terminal with colours: not piped, no NO_COLOR, not TERM=dumb."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return sys.stdout.isatty()


def print_line(line: str) -> None:
    """Print one line, with control characters escaped."""
    print_text(escape(line))


def print_text(text: str) -> None:
    """Print a text of any number of lines unchanged."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()  # for live readers, and so that errors are raised here


def print_prose(text: str, indent: str = "") -> None:
    """Print wrapped sentences; further lines are indented, words are never broken."""
    lines = textwrap.fill(
        escape(text),
        max(terminal_width(), 2 * _NAMES_WIDTH),
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    print_text(lines)


def print_facts(*facts: tuple[str, str]) -> None:
    """Print names and values, one per line."""
    for name, text in facts:
        print_prose(f"{name:<{_NAMES_WIDTH - 1}} {text}", " " * _NAMES_WIDTH)


def print_pose(
    pose: Iterable[Sequence[float]], moved: Mapping[str, Any], source: str = "source", target: str = "target"
) -> None:
    """Print a transform by rows, with enough digits for a cloud of a document."""
    print_line(f"pose of the {source} in the {target}'s frame")
    for line in pose_lines(list(pose), moved.get("centroid"), moved.get("extent")):
        print_line(f"  {line}")


def print_clouds(inputs: Iterable[Mapping[str, Any]]) -> None:
    """Print the number of points of each cloud in a document."""
    for cloud in inputs:
        dropped = cloud["dropped"]
        left_out = f", {dropped} without finite coordinates left out" if dropped else ""
        unkept = cloud.get("not_kept", ())  # a prepared map has none
        lost = f"; {', '.join(unkept)}: neither used nor written" if unkept else ""
        print_facts((cloud["role"], f"{cloud['file']}: {cloud['points']} points{left_out}{lost}"))


def print_files(document: Mapping[str, Any]) -> None:
    """Print the files that a command has written, all in one folder."""
    files = [Path(file) for file in document["files"]]
    if files:
        print_prose(f"wrote {', '.join(file.name for file in files)} to {files[0].parent}/", "  ")


def terminal_width() -> int:
    """Return the number of columns: 80 if the output isn't a terminal."""
    return shutil.get_terminal_size((80, 24)).columns


def shown_name(path: Path) -> str:
    """Return the name of a file for titles: printable."""
    return escape(path.name)


@contextmanager
def show_progress(*, counts: bool) -> Generator[Progress | None, None, None]:
    """Show progress on a terminal until it ends; yield None if standard error isn't one.

    Tasks are shown with counts and the remaining time, or with the elapsed time.
    """
    if not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield None
        return
    from rich import progress  # noqa: PLC0415 - slow to load
    from rich.console import Console  # noqa: PLC0415

    name = progress.TextColumn("{task.description}", markup=False)
    left = progress.TimeRemainingColumn(elapsed_when_finished=True)
    columns = (
        (name, progress.BarColumn(), progress.MofNCompleteColumn(), left)
        if counts
        else (progress.SpinnerColumn(), name, progress.TimeElapsedColumn())
    )
    with progress.Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        yield shown


@contextmanager
def show_stages(*, piped: bool = False) -> Generator[Callable[[str], None], None, None]:
    """Show the current stage and its time; yield the function to call with the name of each stage.

    Without a terminal nothing is shown, or, if `piped`, a line on standard error every 15 seconds.
    """
    with show_progress(counts=False) as progress:
        if progress is None:
            yield _write_at_intervals() if piped else ignore_progress
            return
        task = progress.add_task("", total=None)
        yield lambda stage: progress.update(task, description=escape(stage))


def _write_at_intervals() -> Callable[[str], None]:
    """Return a function that writes the name of a stage to standard error every `_SILENT` seconds."""
    lock, begun = Lock(), monotonic()
    written = begun

    def write(stage: str) -> None:
        nonlocal written
        with lock:
            now = monotonic()
            if now - written >= _SILENT:
                written = now
                write_error(f"{escape(stage)} ({now - begun:.0f} s)")

    return write


def write_figure(path: Path, figure: Figure) -> Path:
    """Write a figure as PNG; return the file."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png")  # pyright: ignore[reportUnknownMemberType]
    io.write_file(path, buffer.getvalue())
    return path


def print_table(
    headers: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    words: Collection[int] = (0,),
    drop: Iterable[int] = (),
    best: Collection[tuple[int, int]] = (),
    wide: bool = False,
) -> None:
    """Print a table that fits the terminal; rows never wrap.

    The columns `words` are left-aligned and may be truncated, numbers are right-aligned. If the width doesn't
    suffice, the columns `drop` are dropped in this order, and named. The cells `best`, (row, column), are
    highlighted.
    """
    from rich.cells import cell_len  # noqa: PLC0415 - slow to load

    table = [[escape(cell) for cell in row] for row in (headers, *rows)]
    widths = [max(map(cell_len, column)) for column in zip(*table, strict=False)]
    shown, is_cut = ([*range(len(widths))], False) if wide else _fit(widths, words, drop)
    for number, row in enumerate(table, -1):
        plain: dict[str, Any] = {"bold": True} if number < 0 else {}
        styles = ({"bold": True, "fg": "green"} if (number, at) in best else plain for at in shown)
        line = (_pad(row[at], widths[at], is_text=at in words, **next(styles)) for at in shown)
        print_text((" " * _GAP).join(line).rstrip())
    left_out = [header for at, header in enumerate(table[0]) if at not in shown]
    if left_out:
        print_prose(f"Left out: {', '.join(left_out)}. --wide shows all.")
    elif is_cut:
        print_line("Cut to fit; --wide shows all.")


def _fit(widths: list[int], words: Collection[int], drop: Iterable[int]) -> tuple[list[int], bool]:
    """Return the columns that fit, with text columns narrowed in place, and whether any is truncated."""
    shown, room = [*range(len(widths))], terminal_width()

    def excess() -> int:
        return sum(widths[at] + _GAP for at in shown) - _GAP - room

    for at in drop:
        if excess() > 0:
            shown.remove(at)
    is_cut = excess() > 0
    for at in sorted((at for at in shown if at in words), key=lambda at: -widths[at]):
        widths[at] = min(widths[at], max(_LEAST_TEXT, widths[at] - max(excess(), 0)))
    return shown, is_cut


def _pad(text: str, width: int, *, is_text: bool, **style: Any) -> str:
    """Return a cell of a given width; the end of a longer text becomes three dots."""
    from rich.cells import cell_len, set_cell_size  # noqa: PLC0415 - slow to load

    if cell_len(text) > width:
        text = set_cell_size(text, width - 3) + "..."
    space = " " * (width - cell_len(text))
    painted = paint(text, **style) if style else text
    return painted + space if is_text else space + painted


def show_value(value: object, form: str = ".3g") -> str:
    """Return a value of a document as text; `form` is for floats."""
    if value is None:
        return UNKNOWN
    if isinstance(value, bool):
        return "yes" if value else "no"
    return format(value, form) if isinstance(value, float) else str(value)


def show_length(value: float | None, digits: int = 3) -> str:
    """Return a length with a number of digits, without an exponent."""
    if value is None:
        return UNKNOWN
    return np.format_float_positional(value, precision=digits, unique=False, fractional=False, trim="-")
