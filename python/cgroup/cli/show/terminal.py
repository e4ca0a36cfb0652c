"""Print lines, facts and poses, in colours if supported; show progress; write pictures."""

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
    """Print a transform by rows, with the digits that a cloud of a document needs."""
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
    """Return the name of a file for titles: printable, and escaped for matplotlib."""
    return escape(path.name).replace("$", r"\$")


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
