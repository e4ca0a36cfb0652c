"""The report of a run: one self-contained page with charts, tables, and the claims of the paper."""

import re
from collections import defaultdict
from collections.abc import Callable, Iterable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple, get_args

import numpy as np
import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

import cgroup
from cgroup._checks.values import as_path
from cgroup._runtime.progress import ignore_progress
from cgroup._runtime.toml import read_packaged
from cgroup.benchmark import tables
from cgroup.benchmark.paper import EXPERIMENTS
from cgroup.benchmark.paper.claims import CRITERIA, Verdict, as_markdown, check_evidence, count_verdicts
from cgroup.benchmark.paper.evidence import Evidence
from cgroup.benchmark.problem import Task
from cgroup.benchmark.report.cells import dataset_table, failure_table, plain_table
from cgroup.benchmark.report.charts import FigureFiles
from cgroup.benchmark.report.pipelines import make_registration_section, make_scene_section
from cgroup.benchmark.report.sections import (
    chart_times,
    make_own_section,
    make_sections,
    make_standings,
    score_table,
)
from cgroup.benchmark.report.trials import make_trial_sections, overview_table
from cgroup.benchmark.store import read_plan
from cgroup.evaluation.protocols import LEAST_PAIRS
from cgroup.io import write_file
from cgroup.io.result_folders import Results, make_folder
from cgroup.io.transforms import format_log
from cgroup.pages.page import page_html, write_page
from cgroup.plots.style import method_style
from cgroup.types import FloatArray

REPORT, CLAIMS, FIGURES, POSES = "report.html", "claims.md", "figures", "poses"
"""Files and folders that `write_report` writes."""

TRUTH = "truth"  # folder of the true poses, beside those of the methods
# Data sets whose pairs are named by a scene and the numbers of two clouds, and the order of the clouds
_SOURCE_FIRST = {"3dmatch-test": False, "3dlomatch-test": False, "kitti": True}
_HEADING = re.compile(r'<h2 id="([^"]+)">(.*?)</h2>')


class ReportData(NamedTuple):
    """Results of each kind, and facts about the run."""

    results: dict[str, pd.DataFrame]
    skips: pd.DataFrame
    machines: pd.DataFrame
    datasets: pd.DataFrame
    config: dict[str, Any]
    missing: dict[str, str]

    @classmethod
    def load(cls, out: Path) -> "ReportData":
        """Read the results of a run; raise `InputError` if there are none."""
        return cls(
            {kind: tables.load(out, kind) for kind in get_args(Task)},
            tables.load_skips(out),
            tables.load_machines(out),
            tables.load_datasets(out),
            read_plan(out, "config"),
            read_plan(out, "missing"),
        )

    @property
    def untimed(self) -> list[pd.DataFrame]:
        """All results that are not empty, except times."""
        return [each for kind, each in self.results.items() if kind != "timing" and len(each)]


def write_report(out: Path | str, *, progress: Callable[[str], Any] | None = None) -> Path:
    """Write a self-contained page about a run, its figures and the claims.

    Parameters
    ----------
    out : path
        Folder of the run, in which ``report.html``, ``claims.md`` and ``figures/*.png|pdf`` are written, and
        poses of 3DMatch and KITTI as ``poses/SET/METHOD/SCENE/est.log``. Further files of an earlier report
        are removed.
    progress : callable, optional
        Called with the name of each step.

    Returns
    -------
    path
        Of the page.
    """
    out, begin = as_path("out", out), progress or ignore_progress
    begin("reading records")
    data, written = ReportData.load(out), Results(out, "report")
    written.check([out / REPORT, out / CLAIMS])
    with written.writing():
        _write(out, data, begin)
    return out / REPORT


def _write(out: Path, data: ReportData, begin: Callable[[str], Any]) -> None:
    frame, trials, registrations = (data.results[kind] for kind in ("experiment", "matches", "registration"))
    methods = (name for each in (frame, trials) if len(each) for name in each["method"].unique())
    figures = FigureFiles(out / FIGURES, begin, methods)
    evidence = Evidence(frame, data.results["timing"])
    begin("checking claims")
    verdicts = check_evidence(evidence)
    write_file(out / CLAIMS, as_markdown(verdicts).encode())
    write_poses(out / POSES, [registrations, trials])
    begin("ranking over all pairs")
    standings = make_standings(frame)
    shown = verdicts if any(verdict.verdict != "not testable" for verdict in verdicts) else []
    body = _render(data, shown, standings=standings, **_make_parts(data, evidence, figures))
    style = read_packaged("cgroup.benchmark.report", "templates/report.css")
    scripts = ("tables.js", "charts.js", *(["claims.js"] if shown else []))
    script = "".join(read_packaged("cgroup.benchmark.report", f"templates/{name}") for name in scripts)
    page = page_html(f"cgroup benchmark: {data.config['name']}", body, css=style, script=script)
    write_page(out / REPORT, page)


def _make_parts(data: ReportData, evidence: Evidence, figures: FigureFiles) -> dict[str, Any]:
    experiments = {each.id: make_sections(each, evidence, figures) for each in EXPERIMENTS.values()}
    further = evidence.further_samples()
    samples = [*evidence.samples(), *further]
    trials = data.results["matches"]
    return {
        "experiments": {id_: sections for id_, sections in experiments.items() if sections},
        "further": [make_own_section(sample, figures) for sample in further],
        "times": chart_times(data.results["timing"], figures),
        "registration": make_registration_section(data.results["registration"], figures),
        "scenes": make_scene_section(data.results["scenes"], figures),
        "trials": make_trial_sections(trials, data.machines, figures),
        "overview": overview_table(trials) if len(trials) else None,
        "scores": score_table(samples) if samples else None,
    }


def _render(data: ReportData, verdicts: list[Verdict], **parts: Any) -> str:  # noqa: ANN401 - for the template
    environment = Environment(
        loader=PackageLoader("cgroup.benchmark.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    frame = data.results["experiment"]
    return environment.get_template("body.html.j2").render(
        config=data.config,
        missing=data.missing,
        version=cgroup.__version__,
        date=datetime.now(tz=timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        totals=_count_totals(data),
        datasets=dataset_table(frame, data.datasets) if len(frame) else plain_table("Data sets", frame),
        failures=failure_table(data.untimed),
        sources=plain_table("Data sets", data.datasets),
        machines=plain_table("Machines", data.machines),
        skips=plain_table("Not timed", data.skips),
        verdicts=verdicts,
        counts=count_verdicts(verdicts),
        criteria=CRITERIA.strip(),
        titles=EXPERIMENTS,
        least_pairs=LEAST_PAIRS,
        label_of=lambda method: method_style(method).label,
        headings=_HEADING.findall,
        **parts,
    )


def _count_totals(data: ReportData) -> dict[str, int]:
    """Return the counts at the top of the page, by their names there."""
    frame = data.results["experiment"]
    counts = {
        "pairs": len(frame.drop_duplicates(["dataset", "pair"])),
        "cases": len(frame.drop_duplicates("case")),
        "records": len(frame),
        "registrations": len(data.results["registration"]),
        "scenes": len(data.results["scenes"]),
        "trials": len(data.results["matches"]),
    }
    failed = sum(int((each["error"] != "").sum()) for each in data.untimed)
    return {name: count for name, count in counts.items() if count} | {"failed records": failed}


def write_poses(out: Path, frames: Iterable[pd.DataFrame]) -> None:
    """Write the poses of pairs whose clouds have numbers, for `cgroup evaluate` and the scripts of others.

    They are in ``SET/METHOD/SCENE/est.log``, and the true ones in ``SET/truth/SCENE/gt.log``. The pose of a
    line ``i j`` maps cloud j into i.
    """
    logs: dict[Path, dict[tuple[int, int], FloatArray]] = defaultdict(dict)
    for frame in frames:
        if frame.empty:
            continue
        chosen = (
            frame["dataset"].isin(_SOURCE_FIRST) & (frame["error"] == "") & (frame.get("skipped", "") == "")
        )
        columns = ("set", "method", "dataset", "pair", "pose", "truth")
        for of_set, method, dataset, pair, found, true in zip(
            *(frame.loc[chosen, name] for name in columns), strict=True
        ):
            *_, scene, numbers = pair.split("/")
            first, second = (int(number) for number in numbers.split("-"))
            clouds = (second, first) if _SOURCE_FIRST[dataset] else (first, second)
            folder = out / _name_folder(of_set)
            if found is not None:
                logs[folder / _name_folder(method) / scene / "est.log"][clouds] = found
            if true is not None:
                logs[folder / TRUTH / scene / "gt.log"][clouds] = true
    for path, log in logs.items():
        make_folder(path.parent)
        write_file(path, format_log(np.array(list(log)), np.array(list(log.values()))).encode())


def _name_folder(label: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-_.+ " else "_" for letter in label)
