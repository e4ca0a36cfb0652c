"""The report of a run: one self-contained page with charts, tables, and the claims of the paper."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import datetime, timezone
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

import cgroup
from cgroup._checks.values import as_path
from cgroup._runtime.progress import ignore_progress
from cgroup.benchmark import tables
from cgroup.benchmark.paper import EXPERIMENTS
from cgroup.benchmark.paper.claims import CRITERIA, check_evidence
from cgroup.benchmark.paper.evidence import Evidence
from cgroup.benchmark.paper.verdicts import Verdict, as_markdown, count_verdicts
from cgroup.benchmark.report.pictures import PictureBook
from cgroup.benchmark.report.pose_files import write_poses
from cgroup.benchmark.report.registration import make_registration_section
from cgroup.benchmark.report.scenes import make_scene_section
from cgroup.benchmark.report.sections import (
    chart_pairs,
    chart_times,
    draw_selections,
    make_own_section,
    make_sections,
)
from cgroup.benchmark.report.standings import make_standings
from cgroup.benchmark.report.tables import dataset_table, failure_table, plain_table, score_table
from cgroup.benchmark.report.trials import make_trial_sections, overview_table
from cgroup.io import write_file
from cgroup.io.result_folders import Results
from cgroup.pages.page import page_html, write_page

if TYPE_CHECKING:  # slow to load
    import pandas as pd

REPORT, CLAIMS, FIGURES, POSES = "report.html", "claims.md", "figures", "poses"
"""Files and folders that `write_report` writes."""


class ReportData(NamedTuple):
    """Results of all kinds, and facts about the run."""

    frame: pd.DataFrame
    timing: pd.DataFrame
    skips: pd.DataFrame
    machines: pd.DataFrame
    datasets: pd.DataFrame
    config: dict[str, Any]
    missing: dict[str, str]
    registrations: pd.DataFrame
    scenes: pd.DataFrame
    trials: pd.DataFrame

    @classmethod
    def load(cls, out: Path) -> ReportData:
        """Read the results of a run; raise `InputError` if there are none."""
        return cls(
            tables.load(out),
            tables.load(out, "timing"),
            tables.load_skips(out),
            tables.load_machines(out),
            tables.load_datasets(out),
            tables.load_config(out),
            tables.load_missing(out),
            tables.load(out, "registration"),
            tables.load(out, "scenes"),
            tables.load(out, "matches"),
        )

    @property
    def results(self) -> list[pd.DataFrame]:
        """Frames of all results except times, without empty ones."""
        return [each for each in (self.frame, self.registrations, self.scenes, self.trials) if len(each)]


def write_report(
    out: Path | str, *, root: Path | str | None = None, progress: Callable[[str], Any] | None = None
) -> Path:
    """Write a self-contained page about a run, its figures and the claims.

    Parameters
    ----------
    out : path
        Folder of the run, in which ``report.html``, ``claims.md`` and ``figures/*.png|pdf`` are written, and
        poses of 3DMatch and KITTI as ``poses/SET/METHOD/SCENE/est.log``. Further files of an earlier report
        are removed.
    root : path, optional
        Folder with the data, for pictures of a few pairs; ``CGROUP_DATA`` by default. Missing pairs are left
        out.
    progress : callable, optional
        Called with the name of each step.

    Returns
    -------
    path
        Of the page.

    Raises
    ------
    InputError
        If the folder has no results, they are damaged, it can't be written to, or a file would be replaced
        that no report wrote.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.report import write_report
    >>> from cgroup.benchmark.run import run
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gc", "gtm"], experiment=[small])
    >>> _ = run(config, Path("results"), backend="threading")
    >>> write_report(Path("results")).name
    'report.html'
    """
    out, root = as_path("out", out), None if root is None else as_path("root", root)
    tell = progress or ignore_progress
    tell("reading records")
    data, results = ReportData.load(out), Results(out, "report")
    results.check([out / REPORT, out / CLAIMS])
    with results.writing():
        _write(out, data, root, tell)
    return out / REPORT


def _write(out: Path, data: ReportData, root: Path | None, tell: Callable[[str], Any]) -> None:
    """Write figures, claims, poses and the page."""
    frames = (each for each in (data.frame, data.trials) if len(each))
    pictures = PictureBook(out / FIGURES, tell, (name for each in frames for name in each["method"].unique()))
    evidence = Evidence(data.frame, data.timing)
    tell("checking claims")
    verdicts = check_evidence(evidence)
    write_file(out / CLAIMS, as_markdown(verdicts).encode())
    write_poses(out / POSES, [data.registrations, data.trials])
    tell("ranking over all pairs")
    standings = make_standings(data.frame, data.trials, data.registrations)
    shown = verdicts if any(verdict.verdict != "not testable" for verdict in verdicts) else []
    body = _render(
        data=data,
        standings=standings,
        verdicts=shown,
        selections=draw_selections(out, evidence, root, pictures),
        **_make_parts(data, evidence, pictures),
    )
    style = _read_part("report.css")
    script = "".join(map(_read_part, ("tables.js", "charts.js", *(["claims.js"] if shown else []))))
    page = page_html(f"cgroup benchmark: {data.config['name']}", body, css=style, script=script)
    write_page(out / REPORT, page)


def _make_parts(data: ReportData, evidence: Evidence, pictures: PictureBook) -> dict[str, Any]:
    """Make the sections that have results."""
    experiments = {each.id: make_sections(each, evidence, pictures) for each in EXPERIMENTS.values()}
    further = evidence.further_samples()
    samples = [*evidence.samples(), *further]
    hows: tuple[Literal["macro", "pooled", "median"], ...] = ("macro", "pooled", "median")
    return {
        "experiments": {id_: sections for id_, sections in experiments.items() if sections},
        "further": [make_own_section(sample, pictures) for sample in further],
        "pairs": chart_pairs(evidence, pictures),
        "times": chart_times(data.timing, pictures),
        "registration": make_registration_section(data.registrations, pictures),
        "scenes": make_scene_section(data.scenes, pictures),
        "trials": make_trial_sections(data.trials, data.machines, pictures),
        "overview": overview_table(data.trials) if len(data.trials) else None,
        "scores": [score_table(samples, how) for how in hows] if samples else [],
    }


def _render(*, data: ReportData, verdicts: list[Verdict], **parts: Any) -> str:  # noqa: ANN401 - for the template
    environment = Environment(
        loader=PackageLoader("cgroup.benchmark.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    frame = data.frame
    return environment.get_template("body.html.j2").render(
        contents=_list_contents(verdicts=verdicts, **parts),
        config=data.config,
        missing=data.missing,
        version=cgroup.__version__,
        date=datetime.now(tz=timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        totals=_count_totals(data),
        datasets=dataset_table(frame, data.datasets) if len(frame) else plain_table("Data sets", frame),
        failures=failure_table(data.results),
        sources=plain_table("Data sets", data.datasets),
        machines=plain_table("Machines", data.machines),
        skips=plain_table("Not timed", data.skips),
        verdicts=verdicts,
        counts=count_verdicts(verdicts),
        criteria=_split_paragraphs(CRITERIA),
        titles=EXPERIMENTS,
        claims_of=lambda each: [
            v for v in verdicts if v.paper_section.startswith(each.sections) and v.verdict != "not testable"
        ],
        **parts,
    )


def _list_contents(**parts: Any) -> list[tuple[str, str]]:  # noqa: ANN401 - as above
    """Return anchors and titles of the sections."""
    selections = parts["selections"]
    own = "Further experiments" if parts["experiments"] else "Experiments"
    return [
        *([("ranking", "Overall ranking")] if parts["standings"] else []),
        *([("registration", "Registration")] if parts["registration"] else []),
        *([("scenes", "Many scans")] if parts["scenes"] else []),
        *([("methods", "Methods on matches")] if parts["trials"] else []),
        *((f"trials-{place}", section.title) for place, section in enumerate(parts["trials"], start=1)),
        *((id_, EXPERIMENTS[id_].title) for id_ in parts["experiments"]),
        *([("further", own)] if parts["further"] else []),
        *([("pairs", "Pair by pair")] if parts["pairs"] else []),
        *([("time", "Time")] if parts["times"] else []),
        *([("selections", "Selected matches")] if selections.drawn or selections.missing else []),
        *([("scores", "All scores")] if parts["scores"] else []),
        *([("claims", "Claims of the paper")] if parts["verdicts"] else []),
        ("data", "Data and machines"),
    ]


def _read_part(name: str) -> str:
    parts = resources.files("cgroup.benchmark.report").joinpath("templates")
    return parts.joinpath(name).read_text(encoding="utf-8")


def _count_totals(data: ReportData) -> dict[str, int]:
    """Return the counts at the top of the page, by their names there."""
    frame, trials = data.frame, data.trials
    counts = {
        "pairs": len(frame.drop_duplicates(["dataset", "pair"])),
        "cases": len(frame.drop_duplicates("case")),
        "groupings": len(frame.drop_duplicates(["case", "method"])),
        "records": len(frame),
        "registrations": len(data.registrations),
        "scenes": len(data.scenes),
        "problems": trials["case"].nunique() if len(trials) else 0,
        "trials": len(trials),
    }
    failed = sum(int((each["error"] != "").sum()) for each in data.results)
    return {name: count for name, count in counts.items() if count} | {"failed records": failed}


def _split_paragraphs(text: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the paragraphs of a docstring, each with the items of its list."""
    for block in text.strip().split("\n\n"):
        lines = " ".join(block.split("\n"))
        if lines.startswith("- "):
            yield "", [item.strip() for item in lines.removeprefix("- ").split(" - ")]
        else:
            yield lines, []
