"""``cgroup benchmark``: runs evaluations and shows the results."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from cgroup.cli import terminal
from cgroup.cli.command import command, examples, make_app
from cgroup.cli.documents import Document
from cgroup.cli.options import JSON, OUTPUT, WIDE, argument, choice, complete_presets, flag, folder, option
from cgroup.cli.process import StoppedError, stop_on_signals
from cgroup.errors import InputError
from cgroup.io.result_folders import check_folder

if TYPE_CHECKING:  # slow to load
    from rich.progress import TaskID

    from cgroup.benchmark.paper.claims import Verdict
    from cgroup.benchmark.report.cells import Table


_DONE = {
    "match": "cases matched",
    "experiment": "groupings",
    "timing": "times",
    "registration": "registrations",
    "scenes": "scenes",
    "matches": "trials",
}
"""Names of the results of each kind."""

_VERDICT_COLORS = {"confirmed": "green", "partly": "yellow", "not confirmed": "red"}
_FAILURES_SHOWN = 10
_INDENT = " " * 15

Backend = Literal["processes", "dask", "threading"]
Format = Literal["table", "markdown"]


_OUT = folder("benchmark", "Folder of the records and everything made from them.", OUTPUT)

app = make_app(
    help="Run the paper's evaluation, draw its figures and check its claims.",
    epilog=examples(*(f"cgroup benchmark {name} --out smoke" for name in ("run smoke", "status", "report"))),
)


@app.callback(invoke_without_command=True)
def _without_command(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        terminal.print_text(context.get_help())


@contextmanager
def _needs_extra() -> Generator[None, None, None]:
    """Raise an `InputError` that names the extra, if a library is missing."""
    try:
        yield
    except ModuleNotFoundError as missing:
        if missing.name is None or missing.name.startswith("cgroup"):
            raise
        message = f"the benchmark needs {missing.name}; pip install 'cgroup[bench]'"
        raise InputError(message) from missing


def _command(*described: str, **more: Any) -> Callable[[Any], Any]:
    return lambda function: command(*described, app=app, **more)(_needs_extra()(function))


# --- run and status ------------------------------------------------------------------------------


def _print_summary(document: Document) -> None:
    done, out = document["results"], document["options"]["out"]
    _print_counts(done)
    terminal.print_line(f"took {timedelta(seconds=round(done['seconds']))}; records are in {out}/")
    if done["failed"]:
        wanted = sum(count["wanted"] for count in done["counts"].values())
        terminal.print_line(f"{done['failed']} of {wanted} failed; see: cgroup benchmark status --out {out}")


def _print_counts(found: Mapping[str, Any]) -> None:
    for stage, count in found["counts"].items():
        if count["wanted"]:
            failed = f", {count['failed']} failed" if count["failed"] else ""
            terminal.print_line(f"{_DONE[stage]:<14} {count['done']} of {count['wanted']}{failed}")
    for name, why in found["left_out"].items():
        terminal.print_prose(f"left out       {name}: {why}", _INDENT)


@_command(
    "run",
    "cgroup benchmark run smoke --out smoke",
    "cgroup benchmark run paper --data ~/data --out paper --workers 8",
    "cgroup benchmark run own.toml --methods gtm,lc,ransac",
    show=_print_summary,
)
def run_command(
    config: str = argument(
        "CONFIG", "TOML file, or a preset: see `cgroup benchmark presets`.", autocompletion=complete_presets
    ),
    *,
    data: Path | None = option("FOLDER", "Folder with the data sets.", None, "$CGROUP_DATA"),
    out: Path = _OUT,
    backend: Backend = choice(
        "processes",
        Backend,
        "Processes on this machine, a Dask cluster, or threads of this process.",
        "Workers",
    ),
    workers: int | None = option("COUNT", "How many workers.", "Workers", "one per core", min=1),
    scheduler: str | None = option(
        "ADDRESS", "Address of the Dask scheduler.", "Workers", "$DASK_SCHEDULER_ADDRESS"
    ),
    retry_failed: bool = flag("--retry-failed", "Run failed problems again.", None),
    methods: str | None = option(
        "NAMES",
        "Methods in place of the configuration's: names with commas between, or all, or paper.",
        None,
        "the configuration's",
    ),
    as_json: bool = JSON,
) -> Document:
    """Compute the results of a configuration. A stopped run continues when started again."""
    from cgroup.benchmark.config import read_config, replace_methods  # noqa: PLC0415 - slow to load
    from cgroup.benchmark.run import run  # noqa: PLC0415

    wanted = read_config(config)
    if methods is not None:
        wanted = replace_methods(wanted, methods.split(","))
    check_folder(out)
    start = time.monotonic()
    using: dict[str, Any] = {"backend": backend, "workers": workers, "scheduler": scheduler}
    with _run_resumably(out, quiet=as_json) as report:
        summary = run(wanted, out, root=data, **using, retry_failed=retry_failed, progress=report)
    return {
        "options": {"config": config, "out": out},
        "results": {
            "counts": {stage: count._asdict() for stage, count in summary.counts.items()},
            "left_out": summary.missing,
            "failed": summary.failed,
            "seconds": time.monotonic() - start,
        },
    }


@contextmanager
def _run_resumably(out: Path, *, quiet: bool) -> Generator[Callable[[str, int, int], None], None, None]:
    """Show the progress of a run, and print how to continue after a stop, unless `quiet`."""
    try:
        with stop_on_signals(), terminal.show_progress(counts=True) as progress:
            tasks: dict[str, TaskID] = {}

            def report(stage: str, done: int, wanted: int) -> None:
                if progress is None:
                    return
                if stage not in tasks:
                    # Earlier results don't count for the speed of this run.
                    tasks[stage] = progress.add_task(f"{_DONE[stage]:<14}", total=wanted, completed=done)
                progress.update(tasks[stage], completed=done)

            yield report
    except StoppedError as stopped:
        if not quiet:
            with suppress(OSError):  # of a terminal that is gone
                terminal.print_line(
                    f"Everything finished is in {out}/; run the same command again to continue."
                )
                sys.stdout.flush()
        raise typer.Exit(stopped.status) from None


def _print_status(document: Document) -> None:
    found = document["results"]
    _print_counts(found)
    failures = found["failures"]
    for failure in failures[:_FAILURES_SHOWN]:
        terminal.print_prose(
            f"failed {failure['times']:>5} x {failure['method']}: {failure['error']}", _INDENT
        )
    if len(failures) > _FAILURES_SHOWN:
        terminal.print_line(f"and {len(failures) - _FAILURES_SHOWN} other errors")


@_command("status", "cgroup benchmark status --out smoke", show=_print_status)
def status_command(out: Path = _OUT) -> Document:
    """Show progress and failures of a run."""
    from cgroup.benchmark import tables  # noqa: PLC0415 - slow to load
    from cgroup.benchmark.store import read_plan  # noqa: PLC0415

    keys = ("method", "error", "times")
    results = {
        "counts": {stage: count._asdict() for stage, count in tables.load_counts(out).items()},
        "left_out": read_plan(out, "missing"),
        "failures": [dict(zip(keys, row, strict=True)) for row in tables.load_failures(out)],
    }
    return {"options": {"out": out}, "results": results}


# --- presets and report --------------------------------------------------------------------------


def _print_presets(document: Document) -> None:
    for preset in document["results"]["presets"]:
        terminal.print_prose(f"{preset['name']:<12} {preset['title']}", " " * 13)
        terminal.print_prose(f"{'':<12} data: {', '.join(preset['data'])}", " " * 19)


@_command("presets", "cgroup benchmark presets", show=_print_presets)
def presets_command() -> Document:
    """List the configurations that come with the package."""
    from cgroup.benchmark.config import preset_names, read_config  # noqa: PLC0415 - slow to load

    presets: list[dict[str, Any]] = []
    for name in preset_names():
        preset = read_config(name)
        data = dict.fromkeys(one for entry in preset.sets for one in entry.dataset or ("generated matches",))
        presets.append({"name": name, "title": preset.title, "data": list(data)})
    return {"results": {"presets": presets}}


def _print_written(document: Document) -> None:
    terminal.print_line("wrote {}, {} and {}/".format(*document["files"]))


@_command("report", "cgroup benchmark report --out smoke", show=_print_written)
def report_command(out: Path = _OUT) -> Document:
    """Write report.html, the figures and claims.md."""
    check_folder(out)
    with terminal.show_stages() as begin:
        from cgroup.benchmark.report import write_report  # noqa: PLC0415 - slow to load

        page = write_report(out, progress=begin)
    return {"options": {"out": out}, "files": [page, out / "claims.md", out / "figures"]}


# --- claims --------------------------------------------------------------------------------------


def _print_claims(document: Document, *, format: Format, wide: bool) -> None:  # noqa: A002 - the option's
    from pydantic import TypeAdapter  # noqa: PLC0415 - slow to load

    from cgroup.benchmark.paper.claims import Verdict, as_markdown  # noqa: PLC0415

    verdicts = TypeAdapter(list[Verdict]).validate_python(document["results"]["claims"])
    if format == "markdown":
        terminal.print_text(as_markdown(verdicts))
        return
    if wide:
        for verdict in verdicts:
            _print_claim(verdict)
    else:
        rows = [(each.id, each.verdict, each.statement) for each in verdicts]
        terminal.print_table(("claim", "verdict", "the paper says"), rows, words=(0, 1, 2))
    terminal.print_prose(document["results"]["counted"])


def _print_claim(claim: Verdict) -> None:
    verdict = terminal.paint(claim.verdict, fg=_VERDICT_COLORS.get(claim.verdict))
    terminal.print_text(f"{terminal.paint(claim.id, bold=True)}  {verdict}")
    said = {"paper": claim.statement, "test": claim.criterion, "measured": claim.measured}
    said |= {"why": claim.explanation, "data": claim.data}
    for name, text in said.items():
        if text:
            terminal.print_prose(f"  {name:<9} {text}", " " * 12)
    terminal.print_text("")


@_command(
    "claims",
    "cgroup benchmark claims --out paper",
    "cgroup benchmark claims --out paper --wide",
    "cgroup benchmark claims --out paper --format markdown > claims.md",
    show=_print_claims,
)
def claims_command(
    *,
    out: Path = _OUT,
    format: Format = choice("table", Format, "How to print them.", OUTPUT),  # noqa: A002, ARG001 - for `show`
) -> Document:
    """Check the paper's statements against the records."""
    with terminal.show_stages() as begin:
        from cgroup.benchmark import tables  # noqa: PLC0415 - slow to load
        from cgroup.benchmark.paper import claims  # noqa: PLC0415

        begin("reading records")
        frame, timing = tables.load(out), tables.load(out, "timing")
        begin("checking claims")
        verdicts = claims.check_claims(frame, timing)
    results = {
        "counts": claims.count_verdicts(verdicts),
        "counted": claims.counts_line(verdicts),
        "claims": [asdict(verdict) for verdict in verdicts],
    }
    return {"options": {"out": out}, "results": results}


# --- rankings ------------------------------------------------------------------------------------


@_command("rankings", "cgroup benchmark rankings --out matches")
def rankings_command(*, out: Path = _OUT, as_json: bool = JSON, wide: bool = WIDE) -> Document | None:
    """Print rankings of grouping methods on matches."""
    from cgroup.benchmark import tables  # noqa: PLC0415 - slow to load
    from cgroup.benchmark.report import trials as report  # noqa: PLC0415
    from cgroup.benchmark.stats import rank_methods  # noqa: PLC0415

    trials = tables.load(out, "matches")
    if trials.empty:
        message = f"{out}: no trials; make some with: cgroup benchmark run matches --out {out}"
        raise InputError(message)
    if as_json:
        sets: dict[str, list[dict[str, Any]]] = {}
        for name, rows in trials.groupby("set", sort=False):
            ranks = rank_methods(report.with_fewest_threads(rows))
            sets[str(name)] = [
                {**rank._asdict(), **{key: getattr(rank, key)._asdict() for key in ("f_score", "registered")}}
                for rank in ranks
            ]
        return {"options": {"out": out}, "results": {"sets": sets}}
    _print_tables("All sets", "", [report.overview_table(trials)], wide=wide)
    for section in report.make_trial_sections(trials, tables.load_machines(out), None):
        _print_tables(section.title, section.label, section.tables, wide=wide)
    return None


def _print_tables(title: str, label: str, tables: Iterable[Table], *, wide: bool) -> None:
    """Print tables of a report below a title."""
    terminal.print_text(f"\n{terminal.paint(title, bold=True)}")
    if label:
        terminal.print_prose(label)
    for table in tables:
        terminal.print_text("")
        terminal.print_prose(f"{table.caption}:")
        words = [at for at, right in enumerate(table.right) if not right]
        rows = [[cell.text for cell in row] for row in table.rows]
        best = {(at, to) for at, row in enumerate(table.rows) for to, cell in enumerate(row) if cell.best}
        drop = range(len(table.headers) - 1, 1, -1)
        terminal.print_table(table.headers, rows, words=words, drop=drop, best=best, wide=wide)
