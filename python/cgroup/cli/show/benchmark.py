"""What ``cgroup benchmark`` prints from its documents, and the progress of a run."""

from __future__ import annotations

import sys
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import typer

from cgroup.cli.show.colors import paint
from cgroup.cli.show.tables import Column, print_table
from cgroup.cli.show.terminal import print_files, print_line, print_prose, print_text, show_bar
from cgroup.cli.signals import StoppedError, stop_on_signals

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Mapping
    from pathlib import Path

    from rich.progress import TaskID

    from cgroup.benchmark.report.cells import Table
    from cgroup.cli.show.json import Document

DONE = {
    "correspond": "cases matched",
    "group": "groupings",
    "score": "scores",
    "time": "times",
    "register": "registrations",
    "try": "trials",
    "judge": "readings judged",
}
"""What each stage counts."""

_VERDICT_COLORS = {"confirmed": "green", "partly": "yellow", "not confirmed": "red"}
_CLAIMS = (
    Column("claim", is_text=True),
    Column("verdict", is_text=True),
    Column("resamples", is_text=True),
    Column("the paper says", is_text=True),
)
_READINGS = (
    Column("reading", is_text=True),
    Column("confirmed"),
    Column("partly"),
    Column("not"),
    Column("moved"),
    Column("better"),
    Column("worse"),
    Column("what is changed", is_text=True, priority=1),
)
_RESAMPLED = (
    "resamples: in how many of {} draws of the same pairs the verdict is the same; "
    "close: it changes in more than 10 %."
)
_FAILURES_SHOWN = 10
_INDENT = " " * 15


def print_summary(document: Document) -> None:
    """Print what a run has done."""
    done = document["results"]
    _print_counts(done["counts"])
    _print_left_out(done["left_out"])
    if done["computed_anew"]:
        print_line(f"computed anew  {done['computed_anew']}")
    out = document["options"]["out"]
    print_line(f"took {_format_duration(done['seconds'])}; records are in {out}/")
    if done["failed"]:
        wanted = sum(count["wanted"] for stage, count in done["counts"].items() if stage != "score")
        print_line(f"{done['failed']} of {wanted} failed; see: cgroup benchmark status --out {out}")


def print_status(document: Document) -> None:
    """Print how far a run is."""
    found = document["results"]
    _print_counts(found["counts"])
    _print_left_out(found["left_out"])
    failures = found["failures"]
    for failure in failures[:_FAILURES_SHOWN]:
        what = failure["method"] or "correspond"
        print_prose(f"failed {failure['times']:>5} x {what}: {failure['error']}", _INDENT)
    if len(failures) > _FAILURES_SHOWN:
        print_line(f"and {len(failures) - _FAILURES_SHOWN} other errors")


def print_presets(document: Document) -> None:
    """Print the configurations that come with the package."""
    for preset in document["results"]["presets"]:
        print_prose(f"{preset['name']:<12} {preset['title']}", " " * 13)
        print_prose(f"{'':<12} data: {', '.join(preset['data'])}", " " * 19)


def print_claims(document: Document, *, wide: bool) -> None:
    """Print verdicts: one row each, or all that is known of them."""
    claims, resamples = document["results"]["claims"], document["options"]["resamples"]
    if wide:
        for claim in claims:
            _print_claim(claim)
    else:
        rows = [(each["id"], each["verdict"], _show_stability(each), each["statement"]) for each in claims]
        shown = [at for at, column in enumerate(_CLAIMS) if resamples or column.header != "resamples"]
        print_table([_CLAIMS[at] for at in shown], [[row[at] for at in shown] for row in rows])
    if resamples:
        print_prose(_RESAMPLED.format(resamples))
    print_prose(document["results"]["counted"])


def print_readings(document: Document, *, wide: bool) -> None:
    """Print how many claims are confirmed under each reading."""
    found = document["results"]["readings"]
    rows = [
        (
            reading["name"],
            *(str(reading["counts"][verdict]) for verdict in ("confirmed", "partly", "not confirmed")),
            str(reading["moved"]),
            *(str(len(reading[change])) for change in ("better", "worse")),
            reading["label"],
        )
        for reading in found
    ]
    print_table(_READINGS, rows, wide=wide)
    print_prose(
        "moved: claims of which a number is another than by default; better, worse: of which the verdict is"
    )
    print_prose(f"by default, {document['results']['counted']}")
    _print_left_out(document["results"]["left_out"])
    print_files(document)
    failed, out = document["results"]["failed"], document["options"]["out"]
    if failed:
        print_line(f"{failed} failed; see: cgroup benchmark status --out {out}")


def print_tables(title: str, label: str, tables: Iterable[Table], *, wide: bool) -> None:
    """Print tables of a report below a title."""
    print_text(f"\n{paint(title, bold=True)}")
    if label:
        print_prose(label)
    for table in tables:
        print_text("")
        print_prose(f"{table.caption}:")
        columns = [
            Column(header, is_text=not right, priority=max(0, at - 1))
            for at, (header, right) in enumerate(zip(table.headers, table.right, strict=True))
        ]
        rows = [[cell.text for cell in row] for row in table.rows]
        best = {(at, to) for at, row in enumerate(table.rows) for to, cell in enumerate(row) if cell.best}
        print_table(columns, rows, best=best, wide=wide)


def _show_stability(claim: Mapping[str, Any]) -> str:
    from cgroup.benchmark.paper.claims import Stability  # noqa: PLC0415 - slow to load

    return str(Stability(**claim["stability"])) if claim["stability"] else ""


def _print_claim(claim: Mapping[str, Any]) -> None:
    verdict = claim["verdict"]
    print_text(f"{paint(claim['id'], bold=True)}  {paint(verdict, fg=_VERDICT_COLORS.get(verdict))}")
    told = {"paper": "statement", "test": "criterion", "measured": "measured", "why": "explanation"}
    for name, key in {**told, "data": "data"}.items():
        if claim[key]:
            print_prose(f"  {name:<9} {claim[key]}", " " * 12)
    if claim["stability"]:
        counts = claim["stability"]["counts"].items()
        drawn = ", ".join(f"{count} {outcome}" for outcome, count in counts if count)
        print_prose(f"  {'resamples':<9} {_show_stability(claim)}: {drawn}", " " * 12)
    print_text("")


def _print_counts(counts: Mapping[str, Mapping[str, int]]) -> None:
    for stage, count in counts.items():
        if not count["wanted"]:
            continue
        failed = f", {count['failed']} failed" if count["failed"] else ""
        print_line(f"{DONE[stage]:<14} {count['done']} of {count['wanted']}{failed}")


def _print_left_out(left_out: Mapping[str, str]) -> None:
    for name, why in left_out.items():
        print_prose(f"left out       {name}: {why}", _INDENT)


def _format_duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"


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
