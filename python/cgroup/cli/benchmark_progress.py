"""How far a run of the benchmark is, on a terminal."""

from __future__ import annotations

import sys
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

import typer

from cgroup.cli.benchmark_output import DONE
from cgroup.cli.show.terminal import print_line, show_bar
from cgroup.cli.signals import StoppedError, stop_on_signals

if TYPE_CHECKING:
    from collections.abc import Callable, Generator
    from pathlib import Path

    from rich.progress import TaskID


@contextmanager
def run_resumably(out: Path, *, quiet: bool) -> Generator[Callable[[str, int, int], None] | None, None, None]:
    """Show how far a run is, and where it is stopped, say how to go on, unless it is to be quiet."""
    try:
        with stop_on_signals(), _show_counts() as report:
            yield report
    except StoppedError as stopped:
        if not quiet:
            with suppress(OSError):  # of a terminal that is gone
                print_line(f"Everything finished is in {out}/; run the same command again to continue.")
                sys.stdout.flush()
        raise typer.Exit(stopped.status) from None


@contextmanager
def _show_counts() -> Generator[Callable[[str, int, int], None] | None, None, None]:
    """Show how far each stage is and how long it will take, on a terminal only."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.progress import (  # noqa: PLC0415 - slow to load
        BarColumn,
        MofNCompleteColumn,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description:<14}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with show_bar(*columns) as progress:
        if progress is None:
            yield None
            return
        tasks: dict[str, TaskID] = {}

        def report(stage: str, done: int, wanted: int) -> None:
            if stage not in tasks:
                # What earlier runs did says nothing of the speed of this one.
                tasks[stage] = progress.add_task(DONE[stage], total=wanted, completed=done)
            progress.update(tasks[stage], completed=done)

        yield report
