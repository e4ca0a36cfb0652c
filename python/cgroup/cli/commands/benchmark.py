"""``cgroup benchmark``: runs evaluations, and shows what came of them."""

from __future__ import annotations

import time
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from cgroup.cli.completion import complete_presets
from cgroup.cli.help import Command, examples, make_app
from cgroup.cli.options import OUTPUT, JsonOption, WideOption
from cgroup.cli.output import Ending
from cgroup.cli.show.benchmark import (
    print_claims,
    print_presets,
    print_readings,
    print_status,
    print_summary,
    print_tables,
    run_resumably,
)
from cgroup.cli.show.json import make_document, print_document
from cgroup.cli.show.terminal import print_line, print_text, show_stages
from cgroup.errors import InputError
from cgroup.io._results import check_folder

if TYPE_CHECKING:
    from collections.abc import Generator, Mapping

    from cgroup.benchmark.paper.readings import ReadingOutcome
    from cgroup.benchmark.stats import Rank
    from cgroup.benchmark.store import Counts

app = make_app(
    help="Run the paper's evaluation, draw its figures and check its claims.",
    epilog=examples(
        "cgroup benchmark run smoke --out smoke",
        "cgroup benchmark status --out smoke",
        "cgroup benchmark report --out smoke",
    ),
)

Backend = Literal["processes", "dask", "threading"]
_WORKERS = "Workers"
_BASE = "readings"

OutOption = Annotated[
    Path,
    typer.Option(
        metavar="FOLDER",
        help="Folder of the records and everything made from them.",
        rich_help_panel=OUTPUT,
    ),
]
DataOption = Annotated[
    Path | None,
    typer.Option(metavar="FOLDER", help="Folder with the data sets.", show_default="$CGROUP_DATA"),
]
FormatOption = Annotated[
    Literal["table", "markdown"],
    typer.Option(metavar="table|markdown", help="How to print them.", rich_help_panel=OUTPUT),
]
ResamplesOption = Annotated[
    int,
    typer.Option(
        min=0,
        metavar="COUNT",
        help="How often the pairs are drawn anew, to tell how sure each verdict is; 0: not at all.",
    ),
]
RetryOption = Annotated[bool, typer.Option("--retry-failed", help="Try again what failed.")]
DEFAULT_OUT = Path("benchmark")


OnlyOption = Annotated[
    str | None,
    typer.Option(metavar="NAMES", help="Readings or questions, with commas between.", show_default="all"),
]


@app.command(
    "run",
    cls=Command,
    epilog=examples(
        "cgroup benchmark run smoke --out smoke",
        "cgroup benchmark run paper --data ~/data --out paper --workers 8",
        "cgroup benchmark run own.toml --methods gtm,lc,ransac",
    ),
)
def run_command(
    config: Annotated[
        str,
        typer.Argument(
            metavar="CONFIG",
            help="TOML file, or a preset: see `cgroup benchmark presets`.",
            show_default=False,
            autocompletion=complete_presets,
        ),
    ],
    *,
    data: DataOption = None,
    out: OutOption = DEFAULT_OUT,
    backend: Annotated[
        Backend,
        typer.Option(
            metavar="|".join(get_args(Backend)),
            help="Processes on this machine, a Dask cluster, or threads of this process.",
            rich_help_panel=_WORKERS,
        ),
    ] = "processes",
    workers: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="COUNT",
            help="How many workers.",
            show_default="one per core",
            rich_help_panel=_WORKERS,
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Address of the Dask scheduler.",
            show_default="$DASK_SCHEDULER_ADDRESS",
            rich_help_panel=_WORKERS,
        ),
    ] = None,
    retry_failed: RetryOption = False,
    methods: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Methods in place of the configuration's: names with commas between, or all, or paper.",
            show_default="the configuration's",
        ),
    ] = None,
    as_json: JsonOption = False,
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
    with run_resumably(out, quiet=as_json) as report:
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
    results = {
        "counts": _list_counts(summary.counts),
        "left_out": summary.missing,
        "computed_anew": summary.damaged,
        "failed": summary.failed,
        "seconds": time.monotonic() - start,
    }
    document = make_document("benchmark run", options={"config": config, "out": out}, results=results)
    Ending(as_json=as_json).finish(document, print_summary)


@app.command("status", cls=Command, epilog=examples("cgroup benchmark status --out smoke"))
def status_command(out: OutOption = DEFAULT_OUT, *, as_json: JsonOption = False) -> None:
    """Show how far a run is, and what failed."""
    with _needs_extra():
        from cgroup.benchmark import tables  # noqa: PLC0415 - slow to load
    failures = [
        dict(zip(("method", "error", "times"), row, strict=True)) for row in tables.load_failures(out)
    ]
    results = {
        "counts": _list_counts(tables.load_counts(out)),
        "left_out": tables.load_missing(out),
        "failures": failures,
    }
    document = make_document("benchmark status", options={"out": out}, results=results)
    Ending(as_json=as_json).finish(document, print_status)


@app.command("presets", cls=Command, epilog=examples("cgroup benchmark presets"))
def presets_command(*, as_json: JsonOption = False) -> None:
    """List the configurations that come with the package."""
    with _needs_extra():
        from cgroup.benchmark.config import preset_names, read_config  # noqa: PLC0415 - slow to load
    presets: list[dict[str, Any]] = []
    for name in preset_names():
        preset = read_config(name)
        data = dict.fromkeys(
            name for entry in preset.sets for name in entry.dataset or ("generated matches",)
        )
        presets.append({"name": name, "title": preset.title, "data": list(data)})
    Ending(as_json=as_json).finish(
        make_document("benchmark presets", results={"presets": presets}), print_presets
    )


@app.command("report", cls=Command, epilog=examples("cgroup benchmark report --out smoke"))
def report_command(
    *, out: OutOption = DEFAULT_OUT, data: DataOption = None, as_json: JsonOption = False
) -> None:
    """Write report.html, the figures and claims.md from the records."""
    check_folder(out)
    with _needs_extra(), show_stages() as begin:
        from cgroup.benchmark.report import write_report  # noqa: PLC0415 - slow to load

        page = write_report(out, root=data, progress=begin)
    files = [page, out / "claims.md", out / "figures"]
    document = make_document("benchmark report", options={"out": out}, files=files)
    Ending(as_json=as_json).finish(
        document, lambda _: print_line(f"wrote {files[0]}, {files[1]} and {files[2]}/")
    )


@app.command(
    "claims",
    cls=Command,
    epilog=examples(
        "cgroup benchmark claims --out paper",
        "cgroup benchmark claims --out paper --wide",
        "cgroup benchmark claims --out paper --resamples 0",
        "cgroup benchmark claims --out paper --format markdown > claims.md",
    ),
)
def claims_command(
    *,
    out: OutOption = DEFAULT_OUT,
    resamples: ResamplesOption = 200,
    format: FormatOption = "table",  # noqa: A002 - the option's name
    as_json: JsonOption = False,
    wide: WideOption = False,
) -> None:
    """Check the paper's statements against the records."""
    with _needs_extra(), show_stages() as begin:
        from cgroup.benchmark import tables  # noqa: PLC0415 - slow to load
        from cgroup.benchmark.paper import claims  # noqa: PLC0415

        begin("reading records")
        frame, timing = tables.load(out), tables.load(out, "timing")
        begin(f"checking claims on {resamples} resamples" if resamples else "checking claims")
        verdicts = claims.check_claims(frame, timing, resamples=resamples)
    if format == "markdown" and not as_json:
        print_text(claims.as_markdown(verdicts))
        return
    results = {
        "counts": claims.count_verdicts(verdicts),
        "counted": claims.counts_line(verdicts),
        "claims": [asdict(verdict) for verdict in verdicts],
    }
    options = {"out": out, "resamples": resamples}
    document = make_document("benchmark claims", options=options, results=results)
    Ending(as_json=as_json).finish(document, lambda document: print_claims(document, wide=wide))


@app.command(
    "rankings",
    cls=Command,
    epilog=examples(
        "cgroup benchmark rankings --out matches",
        "cgroup benchmark rankings --out matches --format markdown > rankings.md",
    ),
)
def rankings_command(
    *,
    out: OutOption = DEFAULT_OUT,
    format: FormatOption = "table",  # noqa: A002 - the option's name
    as_json: JsonOption = False,
    wide: WideOption = False,
) -> None:
    """Print how grouping methods rank on matches."""
    with _needs_extra():
        from cgroup.benchmark import tables  # noqa: PLC0415 - slow to load
        from cgroup.benchmark.report.trial_tables import overview_table, with_fewest_threads  # noqa: PLC0415
        from cgroup.benchmark.report.trials import as_markdown, make_trial_sections  # noqa: PLC0415
        from cgroup.benchmark.stats import rank_methods  # noqa: PLC0415

        trials = tables.load(out, "matches")
    if trials.empty:
        message = f"{out}: no trials there; make some with: cgroup benchmark run matches --out {out}"
        raise InputError(message)
    if as_json:
        sets = {
            str(name): [_list_rank(rank) for rank in rank_methods(with_fewest_threads(rows))]
            for name, rows in trials.groupby("set", sort=False)
        }
        print_document(make_document("benchmark rankings", options={"out": out}, results={"sets": sets}))
        return
    overview, sections = overview_table(trials), make_trial_sections(trials, tables.load_machines(out), None)
    if format == "markdown":
        print_text(as_markdown(overview, sections).rstrip())
        return
    print_tables("All sets", "", [overview], wide=wide)
    for section in sections:
        tables = (section.ranking, section.levels, section.costs, section.failures)
        print_tables(section.title, section.label, [table for table in tables if table], wide=wide)


@app.command(
    "readings",
    cls=Command,
    epilog=examples(
        "cgroup benchmark readings --data ~/data --out readings",
        "cgroup benchmark readings --data ~/data --out readings --only gtm,mutual",
    ),
)
def readings_command(
    config: Annotated[
        str,
        typer.Argument(
            metavar="CONFIG",
            help="What is repeated for every reading: TOML file, or a preset.",
            autocompletion=complete_presets,
        ),
    ] = _BASE,
    *,
    data: DataOption = None,
    out: OutOption = Path(_BASE),
    only: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Readings or questions, with commas between.",
            show_default="all",
        ),
    ] = None,
    resamples: Annotated[
        int,
        typer.Option(min=1, metavar="COUNT", help="Draws of the pairs that show how sure a verdict is."),
    ] = 200,
    workers: Annotated[
        int | None,
        typer.Option(min=1, metavar="COUNT", help="How many workers.", show_default="one per core"),
    ] = None,
    retry_failed: RetryOption = False,
    as_json: JsonOption = False,
    wide: WideOption = False,
) -> None:
    """Read what the paper leaves open in other ways, one at a time, and check its claims each time.

    Stopped and started again, it continues.
    """
    with _needs_extra():
        from cgroup.benchmark import tables  # noqa: PLC0415 - slow to load
        from cgroup.benchmark.config import read_config  # noqa: PLC0415
        from cgroup.benchmark.paper.claims import counts_line  # noqa: PLC0415
        from cgroup.benchmark.paper.reading_tables import write_readings  # noqa: PLC0415
        from cgroup.benchmark.paper.readings import (  # noqa: PLC0415
            add_readings,
            judge_readings,
            list_readings,
        )
        from cgroup.benchmark.run import run  # noqa: PLC0415

    readings = list_readings(None if only is None else [name.strip() for name in only.split(",")])
    wanted = add_readings(read_config(config), readings)
    check_folder(out)
    with run_resumably(out, quiet=as_json) as report:
        summary = run(wanted, out, root=data, workers=workers, retry_failed=retry_failed, progress=report)
        loaded = tables.load(out), tables.load(out, "timing")
        outcomes = judge_readings(*loaded, readings, root=data, resamples=resamples, progress=report)
    files = write_readings(out, outcomes)
    results = {
        "counted": counts_line(list(outcomes[0].verdicts.values())),
        "left_out": summary.missing,
        "failed": summary.failed,
        "readings": [_list_outcome(outcome) for outcome in outcomes],
    }
    options = {"config": config, "out": out, "only": only, "resamples": resamples}
    document = make_document("benchmark readings", options=options, results=results, files=files)
    Ending(as_json=as_json).finish(document, lambda document: print_readings(document, wide=wide))


@contextmanager
def _needs_extra() -> Generator[None, None, None]:
    """Say which extra is missing, where a library of the benchmark is."""
    try:
        yield
    except ModuleNotFoundError as missing:
        if missing.name is None or missing.name.startswith("cgroup"):
            raise
        message = f"the benchmark needs {missing.name}; pip install 'cgroup[bench]'"
        raise InputError(message) from missing


def _list_counts(counts: Mapping[str, Counts]) -> dict[str, dict[str, int]]:
    return {stage: count._asdict() for stage, count in counts.items()}


def _list_rank(rank: Rank) -> dict[str, Any]:
    return {**rank._asdict(), "f_score": rank.f_score._asdict(), "registered": rank.registered._asdict()}


def _list_outcome(outcome: ReadingOutcome) -> dict[str, Any]:
    claims = {
        claim: {
            "verdict": verdict.verdict,
            "held": verdict.held,
            "tests": verdict.tests,
            "measured": verdict.measured,
            "moved": claim in outcome.moved,
            "close": outcome.is_close(claim),
        }
        for claim, verdict in outcome.verdicts.items()
    }
    return {
        "name": outcome.name,
        "label": outcome.label,
        "counts": outcome.counts,
        "moved": len(outcome.moved),
        "better": outcome.better,
        "worse": outcome.worse,
        "claims": claims,
    }
