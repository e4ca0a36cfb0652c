"""What the commands share: lines and tables on the terminal, progress and pictures."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from io import BytesIO
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from cgroup import io
from cgroup._progress import ignore_progress
from cgroup._show import escape

if TYPE_CHECKING:
    from collections.abc import Callable, Generator
    from pathlib import Path

    from matplotlib.figure import Figure
    from rich.progress import ProgressColumn
    from rich.table import Table

    from cgroup.types import FloatArray, PointCloud

INPUT_ERROR = 2
NO_CONSENSUS = 3
UNFORESEEN = 70
OUTPUT_CLOSED = 141
"""Exit statuses, besides that of an interrupt, `cgroup._start.INTERRUPTED`."""

_PLAIN_WIDTH = 120  # of tables where the output isn't a terminal


def print_line(line: str) -> None:
    """Print one line, with escapes for what would not be one."""
    print_text(escape(line))


def print_text(text: str) -> None:
    """Print a text of any number of lines as it is."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()  # whoever reads along sees it, and errors come up here


def print_facts(*facts: tuple[str, str]) -> None:
    """Print names and what there is to say about them, one per line."""
    for name, text in facts:
        print_line(f"{name:<11} {text}")


def print_cloud(role: str, file: Path, cloud: PointCloud) -> None:
    """Print how many points a cloud has."""
    dropped = f", {cloud.dropped} more without finite coordinates left out" if cloud.dropped else ""
    print_facts((role, f"{file}: {len(cloud)} points{dropped}"))


def print_pose(pose: FloatArray) -> None:
    """Print a transform, row by row."""
    print_line("pose of the source in the target's frame")
    for row in pose:
        print_line("  " + " ".join(f"{number:12.6g}" for number in row))


def print_written(folder: Path, *names: str) -> None:
    """Print which files are in a folder now."""
    print_line(f"wrote {', '.join(names)} to {folder}/")


def print_table(table: Table) -> None:
    """Print a table, as wide as the terminal is."""
    console = Console()
    (console if console.is_terminal else Console(width=_PLAIN_WIDTH)).print(table)


def shown_name(path: Path) -> str:
    """Return the name of a file for titles and tables: printable, and no formula to matplotlib."""
    return escape(path.name).replace("$", r"\$")


@contextmanager
def show_bar(*columns: ProgressColumn) -> Generator[Progress | None, None, None]:
    """Show a progress display on a terminal, gone when it is over; None where there is no terminal."""
    console = Console(stderr=True)
    if not console.is_terminal:
        yield None
        return
    with Progress(*columns, console=console, transient=True) as progress:
        yield progress


@contextmanager
def show_stages() -> Generator[Callable[[str], None], None, None]:
    """Show what is being done and for how long; call what is yielded with the name of each stage."""
    with show_bar(
        SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn()
    ) as progress:
        if progress is None:
            yield ignore_progress
            return
        task = progress.add_task("", total=None)
        yield lambda stage: progress.update(task, description=escape(stage))


def write_figure(path: Path, figure: Figure) -> None:
    """Write a figure as PNG."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png")  # pyright: ignore[reportUnknownMemberType]
    io.write_file(path, buffer.getvalue())
