"""One self-contained page with what a run has found: figures, tables, and the claims of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timezone
from importlib import resources
from typing import TYPE_CHECKING, Any, Literal

from jinja2 import Environment, PackageLoader, StrictUndefined

import cgroup
from cgroup._checks.values import as_path
from cgroup._runtime.progress import ignore_progress
from cgroup.benchmark import tables
from cgroup.benchmark.paper import EXPERIMENTS
from cgroup.benchmark.paper.claims import CRITERIA, RESAMPLES, check_evidence
from cgroup.benchmark.paper.evidence import Evidence
from cgroup.benchmark.paper.verdicts import as_markdown, count_verdicts
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
from cgroup.benchmark.report.trial_tables import overview_table
from cgroup.benchmark.report.trials import make_trial_sections
from cgroup.io import write_file
from cgroup.io._results import Results
from cgroup.pages.page import page_html, write_page

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    import pandas as pd

    from cgroup.benchmark.paper.claims import Verdict
    from cgroup.benchmark.tables import PairPose

REPORT, CLAIMS, FIGURES, POSES = "report.html", "claims.md", "figures", "poses"
"""What `write_report` leaves in the run's folder."""


@dataclass(frozen=True, eq=False)
class ReportData:
    """All that a report is made of.

    Attributes
    ----------
    frame, timing, skips : DataFrame
        Records, times, and what wasn't timed.
    machines, datasets : DataFrame
        Machines that made the records; title, role and citation of each data set.
    config : dict
        The run's configuration.
    missing : dict of str to str
        Data sets and pipelines that weren't at hand, and why.
    registrations : DataFrame
        How pipelines registered pairs.
    scenes : DataFrame
        How many scans were registered.
    trials : DataFrame
        How methods grouped matches, each alone.
    poses : list of PairPose
        Poses that trials and registrations have found of pairs.
    """

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
    poses: list[PairPose]

    @classmethod
    def load(cls, out: Path) -> ReportData:
        """Read the records of a run; raises `InputError` if there are none."""
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
            tables.load_poses(out),
        )


def write_report(
    out: Path | str, *, root: Path | str | None = None, progress: Callable[[str], Any] | None = None
) -> Path:
    """Write figures, claims and one self-contained page about a run.

    Parameters
    ----------
    out : path
        Folder of the run. Gets ``report.html``, ``claims.md`` and ``figures/*.png|pdf``; and poses of 3DMatch
        and KITTI, if there are any, as ``poses/SET/METHOD/SCENE/est.log``. What an earlier report wrote and
        this one does not is removed.
    root : path, optional
        Folder with the data, for pictures of a few pairs; the environment says by default. Pairs that
        aren't there are left out.
    progress : callable, optional
        Called with what is being done.

    Returns
    -------
    path
        Of the page.

    Raises
    ------
    InputError
        If the folder has no records, some aren't what was written, it can't be written to, or a file would be
        replaced that no report wrote.

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
    tell(f"checking claims on {RESAMPLES} resamples")
    verdicts = check_evidence(evidence, resamples=RESAMPLES)
    write_file(out / CLAIMS, as_markdown(verdicts).encode())
    write_poses(out / POSES, data.poses)
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
    """Make the sections that there are records for."""
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
        totals=_count_totals(frame, data.registrations, data.scenes, data.trials),
        datasets=dataset_table(frame, data.datasets) if len(frame) else plain_table("Data sets", frame),
        failures=failure_table(frame, data.registrations, data.scenes, data.trials),
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
    """List anchors and titles of the sections that there are."""
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
        *([("selections", "What is selected")] if selections.drawn or selections.missing else []),
        *([("scores", "All scores")] if parts["scores"] else []),
        *([("claims", "Claims of the paper")] if parts["verdicts"] else []),
        ("data", "Data and machines"),
    ]


def _read_part(name: str) -> str:
    parts = resources.files("cgroup.benchmark.report").joinpath("templates")
    return parts.joinpath(name).read_text(encoding="utf-8")


def _count_totals(
    frame: pd.DataFrame, registrations: pd.DataFrame, scenes: pd.DataFrame, trials: pd.DataFrame
) -> dict[str, int]:
    """Count what there is, by what it is called on the page."""
    cases = frame.drop_duplicates("case")
    frames = (frame, registrations, scenes, trials)
    failed = sum(int((each["error"] != "").sum()) for each in frames if len(each))
    counts = {
        "pairs": len(frame.drop_duplicates(["dataset", "pair"])),
        "cases": len(cases),
        "groupings": len(frame.drop_duplicates(["case", "method"])),
        "records": len(frame),
        "registrations": len(registrations),
        "scenes": len(scenes),
        "problems": trials["case"].nunique() if len(trials) else 0,
        "trials": len(trials),
    }
    return {name: count for name, count in counts.items() if count} | {"failed records": failed}


def _split_paragraphs(text: str) -> Iterator[tuple[str, list[str]]]:
    """Paragraphs of a docstring, each with the items of a list that begin with a dash."""
    for block in text.strip().split("\n\n"):
        lines = " ".join(block.split("\n"))
        if lines.startswith("- "):
            yield "", [item.strip() for item in lines.removeprefix("- ").split(" - ")]
        else:
            yield lines, []
