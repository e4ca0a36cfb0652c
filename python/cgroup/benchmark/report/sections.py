"""What the page shows of each experiment: figures with a text for those who don't see them, and a ranking."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportGeneralTypeIssues=false

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import mean_times
from cgroup.benchmark.paper import PAPER_COMPLEXITY, PLACES
from cgroup.benchmark.records.growth import exponents
from cgroup.benchmark.report.examples import choose_examples, draw_example
from cgroup.benchmark.report.pictures import CLOUD_RESOLUTION
from cgroup.benchmark.report.tables import ranking_table, timing_table
from cgroup.errors import CgroupError
from cgroup.plots import (
    inliers_figure,
    pair_precision_figure,
    registration_rate_figure,
    scores_figure,
    timing_figure,
)
from cgroup.plots.curves import sort_methods
from cgroup.plots.style import method_style

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd

    from cgroup.benchmark.evidence import Evidence, Sample
    from cgroup.benchmark.paper import Experiment
    from cgroup.benchmark.report.cells import Table
    from cgroup.benchmark.report.pictures import Picture, PictureBook


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


def make_sections(experiment: Experiment, evidence: Evidence, pictures: PictureBook) -> list[Section]:
    """Make a section for each data set of the paper that an experiment is run on."""
    return [_make_section(experiment, place, evidence, pictures) for place in experiment.places]


def _make_section(experiment: Experiment, place: str, evidence: Evidence, pictures: PictureBook) -> Section:
    anchor = f"{experiment.id}-{place.lower()}"
    sample = evidence.sample(experiment.id, place, every_method=True)
    if sample is None:
        wanted = " or ".join(PLACES[place])
        missing = f"No records: the run has no experiment '{experiment.id}' on {wanted}."
        return Section(anchor, place, missing)
    title = f"{place}: {sample.description}"
    return Section(anchor, title, "", _draw_experiment(sample, anchor, pictures), ranking_table(sample))


def make_own_section(sample: Sample, pictures: PictureBook) -> Section:
    """Section of an experiment that isn't the paper's."""
    anchor = "".join(c if c.isalnum() else "-" for c in f"{sample.experiment.id}-{sample.dataset}").lower()
    drawn = _draw_experiment(sample, anchor, pictures) if sample.levels else []
    title = f"{sample.experiment.id}: {sample.description}"
    return Section(anchor, title, "", drawn, ranking_table(sample))


def _draw_experiment(sample: Sample, anchor: str, pictures: PictureBook) -> list[Picture]:
    experiment, rows = sample.experiment, _name_combinations(sample)
    labels = {"xlabel": experiment.label, "title": f"{experiment.title}: {sample.description}"}
    scores, rates = scores_figure(rows, **labels), registration_rate_figure(rows, **labels)
    drawn = [
        pictures.add(f"{anchor}-scores", scores, _describe_scores(sample)),
        pictures.add(f"{anchor}-registration", rates, _describe_rates(sample)),
    ]
    if experiment.id != "epsilon":  # the same matches at each threshold
        figure = inliers_figure(rows, **labels)
        drawn.append(pictures.add(f"{anchor}-inliers", figure, _describe_inliers(sample)))
    return drawn


def _name_combinations(sample: Sample) -> pd.DataFrame:
    """Tell combinations by detector and descriptor."""
    rows = sample.rows
    if sample.experiment.column != "combination":
        return rows
    return rows.assign(
        x=rows["x"] + " " + rows["detector"].str.upper() + "+" + rows["descriptor"].str.upper()
    )


def _describe_scores(sample: Sample) -> str:
    table = sample.by_level("f_score")
    best = table.mean().idxmax()
    return (
        f"Mean precision, recall and F of {len(table.columns)} methods over {len(table)} levels, "
        f"{sample.experiment.label}; on average {method_style(best).label} has the best F, "
        f"{table.mean().max():.2f}."
    )


def _describe_rates(sample: Sample) -> str:
    rates = sample.overall("registered")
    best = [method_style(method).label for method in rates.index[rates == rates.max()]]
    return (
        f"Share of registered pairs of {len(rates)} methods by each criterion, {sample.experiment.label}; "
        f"the highest mean by the paper's criterion is {rates.max():.2f}, reached by {', '.join(best)}."
    )


def _describe_inliers(sample: Sample) -> str:
    ratios = sample.matches("inlier_ratio")
    return (
        f"Number of initial matches and their inlier ratio, {sample.experiment.label}; the ratio goes from "
        f"{ratios.min():.3f} to {ratios.max():.3f}."
    )


def draw_pairs(evidence: Evidence, pictures: PictureBook) -> list[Picture]:
    """Draw the precision of GC and RANSAC pair by pair, where there is such a run."""
    sample = evidence.sample("clutter", "U3OR", every_method=True)
    if sample is None or not {"gc", "ransac"} <= set(sample.rows["method"]):
        return []
    figure = pair_precision_figure(sample.rows, methods=("gc", "ransac"), title=sample.description)
    rates = sample.overall("registered")
    alt = (
        f"Precision of GC and RANSAC on each pair; above 0.1 on a share of {rates['gc']:.2f} and "
        f"{rates['ransac']:.2f} of the pairs."
    )
    return [pictures.add("pairs-gc-ransac", figure, alt)]


def draw_times(timing: pd.DataFrame, pictures: PictureBook) -> tuple[list[Picture], Table | None]:
    """Draw and list the times; nothing where none were taken."""
    times = mean_times(timing)
    if times.empty:
        return [], None
    fitted = exponents(timing).set_index("method")["exponent"].to_dict()
    title = "Time per grouping, " + ", ".join(timing["dataset"].unique())
    figure = timing_figure(times, exponents=fitted, complexities=PAPER_COMPLEXITY, title=title)
    last = times.iloc[-1].dropna()
    alt = (
        f"Time of {len(times.columns)} methods over the number of matches, logarithmic axes; at n "
        f"{times.index[-1]} {method_style(last.idxmin()).label} is the fastest, "
        f"{method_style(last.idxmax()).label} the slowest."
    )
    return [pictures.add("time", figure, alt)], timing_table(times, fitted)


def draw_selections(
    out: Path, evidence: Evidence, root: Path | None, pictures: PictureBook
) -> tuple[list[Picture], list[str]]:
    """Draw what is selected on a few pairs; returns also why others aren't drawn."""
    methods = sort_methods(evidence.frame["method"].unique())
    drawn: list[Picture] = []
    missing: list[str] = []
    for example in choose_examples(evidence):
        alt = f"What each method selected on {example.dataset}, {example.pair}: lines between matched points."
        try:
            figure = draw_example(out, example, methods, root)
        except CgroupError as error:
            missing.append(f"{example.dataset}, {example.pair}: {error}")
            continue
        name = f"selection-{example.place.lower()}"
        drawn.append(pictures.add(name, figure, alt, resolution=CLOUD_RESOLUTION))
    return drawn, missing
