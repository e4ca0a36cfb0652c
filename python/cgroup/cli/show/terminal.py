"""Print lines, facts and poses, in colours where they are supported; show progress; write pictures."""

from __future__ import annotations

import os
import shutil
import sys
import textwrap
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from threading import Lock
from time import monotonic
from typing import TYPE_CHECKING, Any

import typer

from cgroup import io
from cgroup._checks.quoting import escape
from cgroup._runtime.progress import ignore_progress
from cgroup._show.poses import pose_lines
from cgroup.cli.streams import write_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.progress import Progress

_NAMES_WIDTH = 12  # of the names that facts begin with
_SILENT = 15.0  # seconds between two lines of progress


def paint(text: str, **style: Any) -> str:
    """Return a text in a style, as `typer.style` takes it, or as it is where there are no colours."""
    return typer.style(text, **style) if wants_colors() else text


def wants_colors() -> bool:
    """Whether standard output is a terminal with colours: not piped, no NO_COLOR, not TERM=dumb."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return sys.stdout.isatty()


def print_line(line: str) -> None:
    """Print one line, with escapes for what would not be one."""
    print_text(escape(line))


def print_text(text: str) -> None:
    """Print a text of any number of lines as it is."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()  # whoever reads along sees it, and errors come up here


def print_prose(text: str, indent: str = "") -> None:
    """Print sentences, as wide as the terminal; further lines are indented, names are never broken."""
    lines = textwrap.fill(
        escape(text),
        max(terminal_width(), 2 * _NAMES_WIDTH),
        subsequent_indent=indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
    print_text(lines)


def print_facts(*facts: tuple[str, str]) -> None:
    """Print names and what there is to say about them, one below the other."""
    for name, text in facts:
        print_prose(f"{name:<{_NAMES_WIDTH - 1}} {text}", " " * _NAMES_WIDTH)


def print_pose(
    pose: Iterable[Sequence[float]], moved: Mapping[str, Any], source: str = "source", target: str = "target"
) -> None:
    """Print a transform, row by row, so that it reproduces where it moves a cloud of a document."""
    print_line(f"pose of the {source} in the {target}'s frame")
    for line in pose_lines(list(pose), moved.get("centroid"), moved.get("extent")):
        print_line(f"  {line}")


def print_clouds(inputs: Iterable[Mapping[str, Any]]) -> None:
    """Print how many points each cloud of a document has."""
    for cloud in inputs:
        dropped = cloud["dropped"]
        left_out = f", {dropped} more without finite coordinates left out" if dropped else ""
        unkept = cloud.get("not_kept") or ()  # older documents have none
        lost = f"; {', '.join(unkept)}: neither used nor kept" if unkept else ""
        print_facts((cloud["role"], f"{cloud['file']}: {cloud['points']} points{left_out}{lost}"))


def print_files(document: Mapping[str, Any]) -> None:
    """Print which files a command has written, all in one folder."""
    files = [Path(file) for file in document["files"]]
    if files:
        print_prose(f"wrote {', '.join(file.name for file in files)} to {files[0].parent}/", "  ")


def terminal_width() -> int:
    """Return how many columns there are to print in: 80 where the output isn't a terminal."""
    return shutil.get_terminal_size((80, 24)).columns


def shown_name(path: Path) -> str:
    """Return the name of a file for titles and tables: printable, and no formula to matplotlib."""
    return escape(path.name).replace("$", r"\$")


@contextmanager
def show_progress(*, counts: bool) -> Generator[Progress | None, None, None]:
    """Show progress on a terminal, gone when it is over; None where nothing can be overwritten.

    Tasks are shown by their counts and the time that is left, or with the time that they have taken.
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
    """Show what is being done and for how long; call what is yielded with the name of each stage.

    Where nothing can be overwritten nothing is shown, or if `piped` a line on standard error now and then.
    """
    with show_progress(counts=False) as progress:
        if progress is None:
            yield _write_now_and_then() if piped else ignore_progress
            return
        task = progress.add_task("", total=None)
        yield lambda stage: progress.update(task, description=escape(stage))


def _write_now_and_then() -> Callable[[str], None]:
    """Return what writes the name of a stage to standard error, unless one was written shortly before."""
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
