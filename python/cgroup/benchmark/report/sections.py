"""What the page shows of each experiment: a chart with a text for those who don't see it, and a ranking."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cgroup.benchmark.paper import PAPER_COMPLEXITY
from cgroup.benchmark.paper.evidence import mean_times
from cgroup.benchmark.report.charts import PageChart, estimate_with_intervals
from cgroup.benchmark.report.examples import choose_examples, draw_example
from cgroup.benchmark.report.tables import ranking_table, timing_table
from cgroup.benchmark.tables import exponents
from cgroup.errors import CgroupError
from cgroup.plots.charts import Chart, sort_methods
from cgroup.plots.experiments import (
    draw_times,
    matches_chart,
    pairs_chart,
    rates_chart,
    scores_chart,
    times_chart,
)
from cgroup.plots.style import method_style

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd

    from cgroup.benchmark.paper import Experiment
    from cgroup.benchmark.paper.evidence import Evidence, Sample
    from cgroup.benchmark.report.cells import Table
    from cgroup.benchmark.report.pictures import Picture, PictureBook


_COMPARED = ("gc", "ransac")


@dataclass(frozen=True)
class Section:
    """Experiment on one data set of the paper, or an experiment of one's own.

    Attributes
    ----------
    anchor, title : str
        Link target and heading.
    ranking : Table
        Of the methods.
    chart : PageChart or None
        What becomes of the methods over the levels; None where nothing is varied.
    """

    anchor: str
    title: str
    ranking: Table
    chart: PageChart | None


@dataclass(frozen=True)
class Selections:
    """Pictures of what methods selected, and why others aren't drawn."""

    drawn: list[Picture]
    missing: list[str]


def make_sections(experiment: Experiment, evidence: Evidence, pictures: PictureBook) -> list[Section]:
    """Make a section for each data set of the paper with records of an experiment."""
    samples = (
        (place, evidence.sample(experiment.id, place, every_method=True)) for place in experiment.places
    )
    return [
        _make_section(sample, f"{experiment.id}-{place.lower()}", f"{place}: {sample.description}", pictures)
        for place, sample in samples
        if sample is not None
    ]


def make_own_section(sample: Sample, pictures: PictureBook) -> Section:
    """Section of an experiment that isn't the paper's."""
    anchor = "".join(c if c.isalnum() else "-" for c in f"{sample.experiment.id}-{sample.dataset}").lower()
    title = f"{sample.experiment.id}: {sample.description}{_describe_front(sample)}"
    return _make_section(sample, anchor, title, pictures)


def _describe_front(sample: Sample) -> str:
    """Say what an experiment changes of the front end; "" where that is nothing."""
    changes: dict[str, object] = {}
    for text in set(sample.rows["front"]) - {""}:
        changes |= json.loads(text)
    told = ", ".join(f"{name} {json.dumps(value)}" for name, value in sorted(changes.items()))
    return f"; front end: {told}".replace('"', "") if told else ""


def _make_section(sample: Sample, anchor: str, title: str, pictures: PictureBook) -> Section:
    chart = _chart_experiment(sample, anchor, pictures) if sample.levels else None
    return Section(anchor, title, ranking_table(sample), chart)


def _chart_experiment(sample: Sample, anchor: str, pictures: PictureBook) -> PageChart:
    experiment, rows = sample.experiment, _name_combinations(sample)
    by_method = experiment.label, pictures.styles, estimate_with_intervals
    charts = {"scores": scores_chart(rows, *by_method), "registration": rates_chart(rows, *by_method)}
    if experiment.id != "epsilon":  # the same matches at each threshold
        charts["inliers"] = matches_chart(rows, experiment.label, estimate_with_intervals)
    title = f"{experiment.title}: {sample.description}"
    files = tuple(
        pictures.save(f"{anchor}-{name}", chart.draw(title, columns=min(3, len(chart.panels))))
        for name, chart in charts.items()
    )
    looks = {key: look for chart in charts.values() for key, look in chart.looks.items()}
    joined = Chart([panel for chart in charts.values() for panel in chart.panels], looks)
    return PageChart(anchor, _describe(sample), joined, files)


def _name_combinations(sample: Sample) -> pd.DataFrame:
    """Tell combinations by detector and descriptor."""
    rows = sample.rows
    if sample.experiment.column != "combination":
        return rows
    return rows.assign(
        x=rows["x"] + " " + rows["detector"].str.upper() + "+" + rows["descriptor"].str.upper()
    )


def _describe(sample: Sample) -> str:
    """Say in words what a chart shows."""
    table, rates, ratios = (
        sample.by_level("f_score"),
        sample.overall("registered"),
        sample.matches("inlier_ratio"),
    )
    best = table.mean().idxmax()
    return (
        f"{len(table.columns)} methods over {len(table)} levels, {sample.experiment.label}. On average "
        f"{method_style(best).label} has the best F, {table.mean().max():.2f}. By the paper's criterion "
        f"{_who_registers_most(rates)}. The share of correct initial matches goes from {ratios.min():.3f} to "
        f"{ratios.max():.3f}."
    )


def _who_registers_most(rates: pd.Series) -> str:
    """Say which methods register the most pairs, unless they all do alike."""
    most = [method_style(method).label for method in rates.index[rates == rates.max()]]
    share = f"a share of {rates.max():.2f}"
    if len(most) == len(rates) > 1:
        return f"all methods register as many pairs, {share}"
    return f"{', '.join(most)} {'register' if len(most) > 1 else 'registers'} the most pairs, {share}"


def chart_pairs(evidence: Evidence, pictures: PictureBook) -> PageChart | None:
    """Chart the precision of GC and RANSAC pair by pair, where there is such a run."""
    sample = evidence.sample("clutter", "U3OR", every_method=True)
    if sample is None or not set(_COMPARED) <= set(sample.rows["method"]):
        return None
    chart = pairs_chart(sample.rows, _COMPARED, pictures.styles)
    rates = sample.overall("registered")
    alt = (
        f"Precision of GC and RANSAC on each pair; above 0.1 on a share of {rates['gc']:.2f} and "
        f"{rates['ransac']:.2f} of the pairs."
    )
    file = pictures.save("pairs-gc-ransac", chart.draw(sample.description, columns=2))
    return PageChart(file, alt, chart, (file,))


def chart_times(timing: pd.DataFrame, pictures: PictureBook) -> tuple[PageChart, Table] | None:
    """Chart and list the times; None where none were taken."""
    times = mean_times(timing)
    if times.empty:
        return None
    fitted = exponents(timing).set_index("method")["exponent"].to_dict()
    sources = ", ".join(timing["dataset"].unique())
    told: dict[str, Any] = {"exponents": fitted, "complexities": PAPER_COMPLEXITY, "styles": pictures.styles}
    file = pictures.save("time", draw_times(times, **told, title=f"Time per grouping, {sources}"))
    last = times.iloc[-1].dropna()
    alt = (
        f"Mean time of {len(times.columns)} methods over the number of matches of {sources}, logarithmic "
        f"axes; at n {times.index[-1]:,} {method_style(last.idxmin()).label} is the fastest, "
        f"{method_style(last.idxmax()).label} the slowest."
    )
    return PageChart(file, alt, times_chart(times, **told), (file,)), timing_table(times, fitted)


def draw_selections(out: Path, evidence: Evidence, root: Path | None, pictures: PictureBook) -> Selections:
    """Draw what is selected on a few pairs."""
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
        drawn.append(pictures.keep(name, figure, alt))
    return Selections(drawn, missing)
