"""``cgroup benchmark readings``: the paper's open questions, read in other ways."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cgroup.cli.benchmark_options import DataOption, OutOption, RetryOption, needs_extra
from cgroup.cli.benchmark_output import print_readings
from cgroup.cli.benchmark_progress import run_resumably
from cgroup.cli.completion import complete_presets
from cgroup.cli.help import Command, examples, make_app
from cgroup.cli.options import JsonOption, WideOption
from cgroup.cli.output import Ending
from cgroup.cli.show.json import make_document
from cgroup.io._results import check_folder

if TYPE_CHECKING:
    from cgroup.benchmark.paper.readings import ReadingOutcome

app = make_app()

_BASE = "readings"


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
    with needs_extra():
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
