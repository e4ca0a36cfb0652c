"""``cgroup benchmark``: runs evaluations, and shows what came of them."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

import typer

from cgroup.cli import benchmark_findings, benchmark_readings
from cgroup.cli.benchmark_options import DEFAULT_OUT, DataOption, OutOption, RetryOption, needs_extra
from cgroup.cli.benchmark_output import print_presets, print_status, print_summary
from cgroup.cli.benchmark_progress import run_resumably
from cgroup.cli.completion import complete_presets
from cgroup.cli.help import Command, examples, make_app
from cgroup.cli.options import JsonOption
from cgroup.cli.output import Ending
from cgroup.cli.show.json import make_document
from cgroup.io._results import check_folder

if TYPE_CHECKING:
    from collections.abc import Mapping

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
    with needs_extra():
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
    with needs_extra():
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
    with needs_extra():
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


app.add_typer(benchmark_findings.app)
app.add_typer(benchmark_readings.app)


def _list_counts(counts: Mapping[str, Counts]) -> dict[str, dict[str, int]]:
    return {stage: count._asdict() for stage, count in counts.items()}
