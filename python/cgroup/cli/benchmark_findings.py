"""``cgroup benchmark report``, ``claims`` and ``rankings``: what came of the records."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from cgroup.cli.benchmark_options import (
    DEFAULT_OUT,
    DataOption,
    FormatOption,
    OutOption,
    ResamplesOption,
    needs_extra,
)
from cgroup.cli.benchmark_output import print_claims, print_tables
from cgroup.cli.help import Command, examples, make_app
from cgroup.cli.options import JsonOption, WideOption
from cgroup.cli.output import Ending
from cgroup.cli.show.json import make_document, print_document
from cgroup.cli.show.terminal import print_line, print_text, show_stages
from cgroup.errors import InputError
from cgroup.io._results import check_folder

if TYPE_CHECKING:
    from cgroup.benchmark.stats import Rank

app = make_app()


@app.command("report", cls=Command, epilog=examples("cgroup benchmark report --out smoke"))
def report_command(
    *, out: OutOption = DEFAULT_OUT, data: DataOption = None, as_json: JsonOption = False
) -> None:
    """Write report.html, the figures and claims.md from the records."""
    check_folder(out)
    with needs_extra(), show_stages() as begin:
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
    with needs_extra(), show_stages() as begin:
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
    with needs_extra():
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


def _list_rank(rank: Rank) -> dict[str, Any]:
    return {**rank._asdict(), "f_score": rank.f_score._asdict(), "registered": rank.registered._asdict()}
