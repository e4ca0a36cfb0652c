"""One self-contained page with what a run has found: figures, tables, and the claims of the paper."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportGeneralTypeIssues=false

from __future__ import annotations

import base64
from dataclasses import dataclass, field
from datetime import datetime, timezone
from io import BytesIO
from typing import TYPE_CHECKING, Any

from jinja2 import Environment, PackageLoader, StrictUndefined

import cgroup
from cgroup.benchmark import records
from cgroup.benchmark.claims import CRITERIA, as_markdown, check_claims, count_verdicts
from cgroup.benchmark.claims.base import mean_times
from cgroup.benchmark.evidence import Evidence
from cgroup.benchmark.paper import EXPERIMENTS, PAPER_COMPLEXITY, PLACES
from cgroup.benchmark.pictures import examples, picture
from cgroup.benchmark.report_tables import (
    Table,
    dataset_table,
    failure_table,
    plain_table,
    ranking_table,
    score_table,
    timing_table,
)
from cgroup.errors import CgroupError
from cgroup.io import write_file
from cgroup.plots import (
    inliers_figure,
    pair_precision_figure,
    registration_rate_figure,
    scores_figure,
    timing_figure,
)
from cgroup.plots.curves import ordered
from cgroup.plots.style import method_style

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    import pandas as pd
    from matplotlib.figure import Figure

    from cgroup.benchmark.claims import Verdict
    from cgroup.benchmark.evidence import Sample
    from cgroup.benchmark.paper import Experiment

REPORT, CLAIMS, FIGURES = "report.html", "claims.md", "figures"
"""What `write_report` leaves in the run's folder."""

_RESOLUTION, _CLOUD_RESOLUTION = 150, 100  # dots per inch of PNG files; pictures of clouds are wide


@dataclass(frozen=True, eq=False)
class Results:
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
        Data sets that weren't at hand, and why.
    """

    frame: pd.DataFrame
    timing: pd.DataFrame
    skips: pd.DataFrame
    machines: pd.DataFrame
    datasets: pd.DataFrame
    config: dict[str, Any]
    missing: dict[str, str]

    @classmethod
    def load(cls, out: Path) -> Results:
        """Read the records of a run; raises `InputError` if there are none."""
        return cls(
            records.load(out),
            records.load_timing(out),
            records.load_timing_skips(out),
            records.load_machines(out),
            records.load_datasets(out),
            records.load_config(out),
            records.load_missing(out),
        )


@dataclass(frozen=True)
class Picture:
    """A figure in the page.

    Attributes
    ----------
    name : str
        Of its files, without the ending.
    alt : str
        What it shows, for those who don't see it.
    data : str
        The PNG as base64.
    """

    name: str
    alt: str
    data: str


@dataclass(frozen=True)
class Section:
    """Experiment on one data set of the paper.

    Attributes
    ----------
    anchor, title : str
        Link target and heading.
    missing : str
        What isn't there; "" if there are records.
    pictures : list of Picture
        Figures.
    ranking : Table or None
        Of the methods.
    """

    anchor: str
    title: str
    missing: str = ""
    pictures: list[Picture] = field(default_factory=list)
    ranking: Table | None = None


def write_report(
    out: Path, *, root: Path | None = None, progress: Callable[[str], Any] | None = None
) -> Path:
    """Write figures, claims and one self-contained page about a run.

    Parameters
    ----------
    out : path
        Folder of the run. Gets ``report.html``, ``claims.md`` and ``figures/*.png|pdf``.
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
        If the folder has no records.
    """
    tell = progress or _ignore
    tell("reading records")
    results = Results.load(out)
    pictures = _PictureBook(out / FIGURES, tell)
    evidence = Evidence(results.frame, results.timing, tuple(ordered(results.frame["method"].unique())))
    tell("checking claims")
    verdicts = check_claims(results.frame, results.timing)
    write_file(out / CLAIMS, as_markdown(verdicts).encode())
    experiments = {each.id: _sections(each, evidence, pictures) for each in EXPERIMENTS.values()}
    page = _render(
        results=results,
        verdicts=verdicts,
        experiments=experiments,
        further=[_own_section(sample, pictures) for sample in evidence.further_samples()],
        pairs=_pair_pictures(evidence, pictures),
        times=_time_pictures(results, pictures),
        selections=_selection_pictures(out, evidence, root, pictures),
        scores=[score_table(evidence.samples(), how) for how in ("macro", "pooled", "median")],
    )
    write_file(out / REPORT, page.encode())
    return out / REPORT


class _PictureBook:
    """Saves figures in the folder, and keeps them for the page."""

    def __init__(self, folder: Path, tell: Callable[[str], Any]) -> None:
        self._folder = folder
        self._tell = tell
        folder.mkdir(parents=True, exist_ok=True)

    def add(self, name: str, figure: Figure, alt: str, *, resolution: int = _RESOLUTION) -> Picture:
        self._tell(f"figure {name}")
        png = _saved(figure, "png", resolution)
        write_file(self._folder / f"{name}.png", png)
        figure.set_layout_engine("none")  # it is laid out; doing so again takes as long as drawing
        write_file(self._folder / f"{name}.pdf", _saved(figure, "pdf", resolution))
        return Picture(name, alt, base64.b64encode(png).decode())


def _saved(figure: Figure, kind: str, resolution: int) -> bytes:
    buffer = BytesIO()
    # A date would make the same figure another file each time.
    metadata = {"CreationDate": None} if kind == "pdf" else {}
    figure.savefig(buffer, format=kind, dpi=resolution, metadata=metadata)
    return buffer.getvalue()


def _sections(experiment: Experiment, evidence: Evidence, pictures: _PictureBook) -> list[Section]:
    return [_section(experiment, place, evidence, pictures) for place in experiment.places]


def _section(experiment: Experiment, place: str, evidence: Evidence, pictures: _PictureBook) -> Section:
    anchor = f"{experiment.id}-{place.lower()}"
    sample = evidence.sample(experiment.id, place)
    if sample is None:
        wanted = " or ".join(PLACES[place])
        missing = f"No records: the run has no experiment '{experiment.id}' on {wanted}."
        return Section(anchor, place, missing)
    title = f"{place}: {sample.description}"
    return Section(anchor, title, "", _experiment_pictures(sample, anchor, pictures), ranking_table(sample))


def _own_section(sample: Sample, pictures: _PictureBook) -> Section:
    """Section of an experiment that isn't the paper's."""
    anchor = "".join(c if c.isalnum() else "-" for c in f"{sample.experiment.id}-{sample.dataset}").lower()
    drawn = _experiment_pictures(sample, anchor, pictures) if sample.levels else []
    title = f"{sample.experiment.id}: {sample.description}"
    return Section(anchor, title, "", drawn, ranking_table(sample))


def _experiment_pictures(sample: Sample, anchor: str, pictures: _PictureBook) -> list[Picture]:
    experiment, rows = sample.experiment, _with_names(sample)
    labels = {"xlabel": experiment.label, "title": f"{experiment.title}: {sample.description}"}
    drawn = [
        pictures.add(f"{anchor}-scores", scores_figure(rows, **labels), _scores_alt(sample)),
        pictures.add(f"{anchor}-registration", registration_rate_figure(rows, **labels), _rates_alt(sample)),
    ]
    if experiment.id != "epsilon":  # the same matches at each threshold
        figure = inliers_figure(rows, **labels)
        drawn.append(pictures.add(f"{anchor}-inliers", figure, _inliers_alt(sample)))
    return drawn


def _with_names(sample: Sample) -> pd.DataFrame:
    """Tell combinations by detector and descriptor."""
    rows = sample.rows
    if sample.experiment.column != "combination":
        return rows
    return rows.assign(
        x=rows["x"] + " " + rows["detector"].str.upper() + "+" + rows["descriptor"].str.upper()
    )


def _scores_alt(sample: Sample) -> str:
    table = sample.by_level("f_score")
    best = table.mean().idxmax()
    return (
        f"Mean precision, recall and F of {len(table.columns)} methods over {len(table)} levels, "
        f"{sample.experiment.label}; on average {method_style(best).label} has the best F, "
        f"{table.mean().max():.2f}."
    )


def _rates_alt(sample: Sample) -> str:
    rates = sample.overall("registered")
    best = [method_style(method).label for method in rates.index[rates == rates.max()]]
    return (
        f"Share of registered pairs of {len(rates)} methods by each criterion, {sample.experiment.label}; "
        f"the highest mean by the paper's criterion is {rates.max():.2f}, reached by {', '.join(best)}."
    )


def _inliers_alt(sample: Sample) -> str:
    ratios = sample.matches("inlier_ratio")
    return (
        f"Number of initial matches and their inlier ratio, {sample.experiment.label}; the ratio goes from "
        f"{ratios.min():.3f} to {ratios.max():.3f}."
    )


def _pair_pictures(evidence: Evidence, pictures: _PictureBook) -> list[Picture]:
    sample = evidence.sample("clutter", "U3OR")
    if sample is None or not {"gc", "ransac"} <= set(sample.rows["method"]):
        return []
    figure = pair_precision_figure(sample.rows, methods=("gc", "ransac"), title=sample.description)
    rates = sample.overall("registered")
    alt = (
        f"Precision of GC and RANSAC on each pair; above 0.1 on a share of {rates['gc']:.2f} and "
        f"{rates['ransac']:.2f} of the pairs."
    )
    return [pictures.add("pairs-gc-ransac", figure, alt)]


def _time_pictures(results: Results, pictures: _PictureBook) -> tuple[list[Picture], Table | None]:
    times = mean_times(results.timing)
    if times.empty:
        return [], None
    fitted = records.exponents(results.timing).set_index("method")["exponent"].to_dict()
    title = "Time per grouping, " + ", ".join(results.timing["dataset"].unique())
    figure = timing_figure(times, exponents=fitted, complexities=PAPER_COMPLEXITY, title=title)
    last = times.iloc[-1].dropna()
    alt = (
        f"Time of {len(times.columns)} methods over the number of matches, logarithmic axes; at n "
        f"{times.index[-1]} {method_style(last.idxmin()).label} is the fastest, "
        f"{method_style(last.idxmax()).label} the slowest."
    )
    return [pictures.add("time", figure, alt)], timing_table(times, fitted)


def _selection_pictures(
    out: Path, evidence: Evidence, root: Path | None, pictures: _PictureBook
) -> tuple[list[Picture], list[str]]:
    """Pictures of a few pairs, and why others aren't there."""
    drawn: list[Picture] = []
    missing: list[str] = []
    for example in examples(evidence):
        alt = f"What each method selected on {example.dataset}, {example.pair}: lines between matched points."
        try:
            figure = picture(out, example, evidence.methods, root)
        except CgroupError as error:
            missing.append(f"{example.dataset}, {example.pair}: {error}")
            continue
        name = f"selection-{example.place.lower()}"
        drawn.append(pictures.add(name, figure, alt, resolution=_CLOUD_RESOLUTION))
    return drawn, missing


def _render(*, results: Results, verdicts: list[Verdict], **parts: Any) -> str:  # noqa: ANN401 - for the template
    environment = Environment(
        loader=PackageLoader("cgroup.benchmark"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    frame = results.frame
    return environment.get_template("report.html.j2").render(
        config=results.config,
        missing=results.missing,
        version=cgroup.__version__,
        date=datetime.now(tz=timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        totals=_totals(frame),
        datasets=dataset_table(frame, results.datasets),
        failures=failure_table(frame),
        machines=plain_table("Machines", results.machines),
        skips=plain_table("Not timed", results.skips),
        verdicts=verdicts,
        counts=count_verdicts(verdicts),
        criteria=_paragraphs(CRITERIA),
        titles={each.id: each for each in EXPERIMENTS.values()},
        claims_of=lambda each: [v for v in verdicts if v.paper_section.startswith(each.sections)],
        **parts,
    )


def _totals(frame: pd.DataFrame) -> dict[str, int]:
    cases = frame.drop_duplicates("case")
    return {
        "pairs": len(frame.drop_duplicates(["dataset", "pair"])),
        "cases": len(cases),
        "groupings": len(frame.drop_duplicates(["case", "method"])),
        "records": len(frame),
        "failed": int((frame["error"] != "").sum()),
    }


def _paragraphs(text: str) -> Iterator[tuple[str, list[str]]]:
    """Paragraphs of a docstring, each with the items of a list that begin with a dash."""
    for block in text.strip().split("\n\n"):
        lines = " ".join(block.split("\n"))
        if lines.startswith("- "):
            yield "", [item.strip() for item in lines.removeprefix("- ").split(" - ")]
        else:
            yield lines, []


def _ignore(_what: str) -> None:
    """Stand in where nobody watches."""
