"""``cgroup benchmark``: runs evaluations, and shows what came of them."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from cgroup.cli.signals import StoppedError, stop_on_signals
from cgroup.cli.terminal import print_line, print_table, print_text, show_bar, show_stages
from cgroup.errors import InputError
from cgroup.io._results import check_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Sequence

    from cgroup.benchmark.claims import Verdict
    from cgroup.benchmark.records.progress import Counts
    from cgroup.benchmark.run import Summary

_DONE = {
    "correspond": "cases matched",
    "group": "groupings",
    "score": "scores",
    "time": "times",
    "register": "registrations",
    "try": "trials",
}
_VERDICT_STYLES = {"confirmed": "green", "partly": "yellow", "not confirmed": "red", "not testable": "dim"}
_FAILURES_SHOWN = 10
DAMAGED = 1
"""Exit status of ``check`` where something is amiss."""

app = typer.Typer(help="Run the paper's evaluation, draw its figures and check its claims.")

OutOption = Annotated[Path, typer.Option(help="Folder of the records and everything made from them.")]
DataOption = Annotated[
    Path | None, typer.Option(help="Folder with the data sets.", show_default="$CGROUP_DATA")
]
DEFAULT_OUT = Path("benchmark")


@app.command("run")
def run_command(
    config: Annotated[str, typer.Argument(help="TOML file, or a preset: see `cgroup benchmark presets`.")],
    *,
    data: DataOption = None,
    out: OutOption = DEFAULT_OUT,
    backend: Annotated[
        Literal["processes", "dask", "threading"],
        typer.Option(help="Processes on this machine, a Dask cluster, or threads of this process."),
    ] = "processes",
    workers: Annotated[
        int | None, typer.Option(min=1, help="How many workers.", show_default="one per core")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(help="Address of the Dask scheduler.", show_default="$DASK_SCHEDULER_ADDRESS"),
    ] = None,
    retry_failed: Annotated[bool, typer.Option("--retry-failed", help="Try again what failed.")] = False,
    methods: Annotated[
        str | None,
        typer.Option(
            help="Methods in place of the configuration's: names with commas between, or all, or paper.",
            show_default="the configuration's",
        ),
    ] = None,
) -> None:
    """Compute what a configuration asks for. Stopped and started again, it continues."""
    with _needs_extra():
        from cgroup.benchmark.config import read_config, replace_methods  # noqa: PLC0415 - slow to load
        from cgroup.benchmark.run import run  # noqa: PLC0415

    wanted = read_config(config)
    if methods is not None:
        wanted = replace_methods(wanted, methods.split(","))
    check_folder(out)
    start = time.monotonic()
    try:
        with stop_on_signals(), _show_counts() as report:
            summary = run(
                wanted,
                out,
                root=data,
                backend=backend,
                workers=workers,
                scheduler=scheduler,
                retry_failed=retry_failed,
                progress=report,
            )
    except StoppedError as stopped:
        with suppress(OSError):  # of a terminal that is gone
            print_line(f"Everything finished is in {out}/; run the same command again to continue.")
            sys.stdout.flush()
        raise typer.Exit(stopped.status) from None
    _print_summary(summary, out, time.monotonic() - start)


@app.command("status")
def status_command(out: OutOption = DEFAULT_OUT) -> None:
    """Show how far a run is, and what failed."""
    with _needs_extra():
        from cgroup.benchmark import records  # noqa: PLC0415 - slow to load
    _print_counts(records.load_counts(out))
    _print_missing(records.load_missing(out))
    _print_failures(records.load_failures(out))


@app.command("check")
def check_command(out: OutOption = DEFAULT_OUT) -> None:
    """Read all records, and say whether they are what was written; exit status 1 if some aren't."""
    with _needs_extra():
        from cgroup.benchmark import records  # noqa: PLC0415 - slow to load
    health = records.check(out)
    for table, count in health.whole.items():
        if count:
            print_line(f"{table:<20} {count} whole")
    for damaged in health.damaged:
        print_line(f"damaged: {damaged.name}")
    for fault in health.faults:
        print_line(f"fault of the file: {fault}")
    if not health.sound:
        print_line("the next run sets aside what is damaged, keeps the old file, and computes it anew")
        raise typer.Exit(DAMAGED)
    print_line("all records are whole" if health.whole else "the file is whole; its layout has no checksums")


@app.command("presets")
def presets_command() -> None:
    """List the configurations that come with the package."""
    with _needs_extra():
        from cgroup.benchmark.config import preset_names, read_config  # noqa: PLC0415 - slow to load
    for name in preset_names():
        preset = read_config(name)
        sets = preset.registration.sets if preset.registration else ()
        trials = preset.trials.sets if preset.trials else ()
        entries = (*preset.experiment, *sets, *trials)
        datasets = dict.fromkeys(
            name for entry in entries for name in entry.dataset or ("generated matches",)
        )
        print_line(f"{name:<12} {preset.title}")
        print_line(f"{'':<12} data: {', '.join(datasets)}")


@app.command("report")
def report_command(*, out: OutOption = DEFAULT_OUT, data: DataOption = None) -> None:
    """Write report.html, the figures and claims.md from the records."""
    check_folder(out)
    with _needs_extra(), show_stages() as begin:
        from cgroup.benchmark.report import write_report  # noqa: PLC0415 - slow to load

        page = write_report(out, root=data, progress=begin)
    print_line(f"wrote {page}, {out / 'claims.md'} and {out / 'figures'}/")


@app.command("claims")
def claims_command(
    out: OutOption = DEFAULT_OUT,
    format: Annotated[  # noqa: A002 - the option's name
        Literal["table", "markdown", "json"], typer.Option(help="How to print them.")
    ] = "table",
) -> None:
    """Check the paper's statements against the records."""
    with _needs_extra():
        from cgroup.benchmark import claims, records  # noqa: PLC0415 - slow to load

        verdicts = claims.check_claims(records.load(out), records.load_timing(out))
    if format == "table":
        _print_verdicts(verdicts)
        print_line(claims.counts_line(verdicts))
    else:
        print_text(claims.as_markdown(verdicts) if format == "markdown" else claims.as_json(verdicts))


@app.command("rankings")
def rankings_command(out: OutOption = DEFAULT_OUT) -> None:
    """Print how grouping methods rank on matches, as Markdown."""
    with _needs_extra():
        from cgroup.benchmark import records  # noqa: PLC0415 - slow to load
        from cgroup.benchmark.report.trial_tables import overview_table  # noqa: PLC0415
        from cgroup.benchmark.report.trials import as_markdown, make_trial_sections  # noqa: PLC0415

        trials = records.load_trials(out)
    if trials.empty:
        message = f"{out}: no trials there; make some with: cgroup benchmark run matches --out {out}"
        raise InputError(message)
    sections = make_trial_sections(trials, records.load_machines(out), None)
    print_text(as_markdown(overview_table(trials), sections).rstrip())


# --- the terminal --------------------------------------------------------------------------------


@contextmanager
def _needs_extra() -> Generator[None, None, None]:
    try:
        yield
    except ModuleNotFoundError as missing:
        if missing.name is None or missing.name.startswith("cgroup"):
            raise
        message = f"the benchmark needs {missing.name}; pip install 'cgroup[bench]'"
        raise InputError(message) from missing


@contextmanager
def _show_counts() -> Generator[Callable[[str, int, int], None] | None, None, None]:
    """Show how far each stage is and how long it will take, on a terminal only."""
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
                tasks[stage] = progress.add_task(_DONE[stage], total=wanted, completed=done)
            progress.update(tasks[stage], completed=done)

        yield report


def _print_summary(summary: Summary, out: Path, seconds: float) -> None:
    _print_counts(summary.counts)
    _print_missing(summary.missing)
    if summary.damaged:
        print_line(f"computed anew  {summary.damaged}")
    print_line(f"took {_format_duration(seconds)}; records are in {out}/")
    if summary.failed:
        wanted = sum(count.wanted for stage, count in summary.counts.items() if stage != "score")
        print_line(f"{summary.failed} of {wanted} failed; see: cgroup benchmark status --out {out}")


def _print_counts(counts: dict[str, Counts]) -> None:
    for stage, count in counts.items():
        if not count.wanted:
            continue
        failed = f", {count.failed} failed" if count.failed else ""
        print_line(f"{_DONE[stage]:<14} {count.done} of {count.wanted}{failed}")


def _print_missing(missing: dict[str, str]) -> None:
    for name, why in missing.items():
        print_line(f"left out       {name}: {why}")


def _print_failures(failures: Sequence[tuple[str, str, int]]) -> None:
    for method, error, times in failures[:_FAILURES_SHOWN]:
        print_line(f"failed {times:>5} x {method or 'correspond'}: {error}")
    if len(failures) > _FAILURES_SHOWN:
        print_line(f"and {len(failures) - _FAILURES_SHOWN} other errors")


def _print_verdicts(verdicts: Iterable[Verdict]) -> None:
    table = Table(show_lines=True)
    for header in ("claim", "the paper says", "verdict", "measured", "data"):
        table.add_column(header, no_wrap=header == "claim")
    for verdict in verdicts:
        why = f" Why: {verdict.explanation}" if verdict.explanation else ""
        table.add_row(
            verdict.id,
            verdict.statement,
            Text(verdict.verdict, style=_VERDICT_STYLES[verdict.verdict]),
            Text(verdict.measured + why),  # plain: its brackets aren't markup
            verdict.data,
        )
    print_table(table)


def _format_duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min {rest} s" if minutes else f"{rest} s"
