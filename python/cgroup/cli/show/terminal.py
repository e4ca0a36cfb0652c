"""Print lines, facts and poses; show progress; write pictures."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cgroup import io
from cgroup._checks.quoting import escape
from cgroup._runtime.progress import ignore_progress

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Mapping, Sequence

    from matplotlib.figure import Figure
    from rich.progress import Progress, ProgressColumn

_NAMES_WIDTH = 12  # of the names that facts begin with


def print_line(line: str) -> None:
    """Print one line, with escapes for what would not be one."""
    print_text(escape(line))


def print_text(text: str) -> None:
    """Print a text of any number of lines as it is."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()  # whoever reads along sees it, and errors come up here


def print_prose(text: str, indent: str = "") -> None:
    """Print sentences, as wide as the terminal; further lines are indented, names are never broken."""
    print_text(_wrap(escape(text), indent))


def print_facts(*facts: tuple[str, str]) -> None:
    """Print names and what there is to say about them, one below the other."""
    for name, text in facts:
        print_prose(f"{name:<{_NAMES_WIDTH - 1}} {text}", " " * _NAMES_WIDTH)


def print_pose(pose: Iterable[Sequence[float]]) -> None:
    """Print a transform, row by row."""
    print_line("pose of the source in the target's frame")
    for row in pose:
        print_line("  " + " ".join(f"{number:12.6g}" for number in row))


def print_clouds(inputs: Iterable[Mapping[str, Any]]) -> None:
    """Print how many points each cloud of a document has."""
    for cloud in inputs:
        dropped = cloud["dropped"]
        left_out = f", {dropped} more without finite coordinates left out" if dropped else ""
        print_facts((cloud["role"], f"{cloud['file']}: {cloud['points']} points{left_out}"))


def print_files(document: Mapping[str, Any]) -> None:
    """Print which files a command has written, all in one folder."""
    files = [Path(file) for file in document["files"]]
    print_prose(f"wrote {', '.join(file.name for file in files)} to {files[0].parent}/", "  ")


def terminal_width() -> int:
    """Return how many columns there are to print in: 80 where the output isn't a terminal."""
    return shutil.get_terminal_size((80, 24)).columns


def _wrap(text: str, indent: str) -> str:
    return textwrap.fill(
        text,
        max(terminal_width(), 2 * _NAMES_WIDTH),
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )


def shown_name(path: Path) -> str:
    """Return the name of a file for titles and tables: printable, and no formula to matplotlib."""
    return escape(path.name).replace("$", r"\$")


def _can_overwrite() -> bool:
    """Tell whether errors go to a terminal on which a line can be written again."""
    return sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


@contextmanager
def show_bar(*columns: ProgressColumn) -> Generator[Progress | None, None, None]:
    """Show a progress display on a terminal, gone when it is over; None where nothing can be overwritten."""
    if not _can_overwrite():
        yield None
        return
    from rich.console import Console  # noqa: PLC0415 - slow to load
    from rich.progress import Progress  # noqa: PLC0415

    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        yield progress


@contextmanager
def show_stages() -> Generator[Callable[[str], None], None, None]:
    """Show what is being done and for how long; call what is yielded with the name of each stage."""
    if not _can_overwrite():
        yield ignore_progress
        return
    from rich.console import Console  # noqa: PLC0415 - slow to load
    from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn  # noqa: PLC0415

    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("", total=None)
        yield lambda stage: progress.update(task, description=escape(stage))


def write_figure(path: Path, figure: Figure) -> None:
    """Write a figure as PNG."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png")  # pyright: ignore[reportUnknownMemberType]
    io.write_file(path, buffer.getvalue())
