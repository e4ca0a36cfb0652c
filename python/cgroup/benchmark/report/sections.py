"""Sections of the report on experiments: charts with texts for readers who can't see them, and rankings."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from cgroup.benchmark import tables
from cgroup.benchmark.paper import PAPER_COMPLEXITY, PAPER_EPSILON, Experiment
from cgroup.benchmark.paper.evidence import Evidence, Sample, mean_times
from cgroup.benchmark.report.cells import Table
from cgroup.benchmark.report.charts import PageChart, estimate_with_intervals
from cgroup.benchmark.report.pictures import Picture, PictureBook
from cgroup.benchmark.report.tables import ranking_table, timing_table
from cgroup.datasets import CorrespondencePair, open_dataset
from cgroup.errors import CgroupError, InputError
from cgroup.evaluation import correct_matches
from cgroup.plots import comparison_figure
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

if TYPE_CHECKING:  # slow to load
    import pandas as pd

_COMPARED = ("gc", "ransac")
_TYPICAL = {"B3R": "noise", "U3OR": "clutter", "U3M": "overlap"}


class Section(NamedTuple):
    """An experiment on one data set; `chart` is None where nothing is varied."""

    anchor: str
    title: str
    ranking: Table
    chart: PageChart | None


class Example(NamedTuple):
    """A case to be drawn: the one with the median F on a data set of the paper."""

    place: str
    dataset: str
    pair: str
    case: str
    origin: str


class Selections(NamedTuple):
    """Pictures of the groups of each method on a few pairs, and why others aren't drawn."""

    drawn: list[Picture]
    missing: list[str]


def make_sections(experiment: Experiment, evidence: Evidence, pictures: PictureBook) -> list[Section]:
    """Make a section for each data set of the paper with results of an experiment."""
    samples = (
        (place, evidence.sample(experiment.id, place, every_method=True)) for place in experiment.places
    )
    return [
        _make_section(sample, f"{experiment.id}-{place.lower()}", f"{place}: {sample.description}", pictures)
        for place, sample in samples
        if sample is not None
    ]


def make_own_section(sample: Sample, pictures: PictureBook) -> Section:
    """Make the section of an experiment that is not the paper's."""
    anchor = "".join(c if c.isalnum() else "-" for c in f"{sample.experiment.id}-{sample.dataset}").lower()
    title = f"{sample.experiment.id}: {sample.description}{_describe_front(sample)}"
    return _make_section(sample, anchor, title, pictures)


def _describe_front(sample: Sample) -> str:
    """Return the changes of an experiment to the front end in words; "" if there are none."""
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
    """Name combinations by detector and descriptor."""
    rows = sample.rows
    if sample.experiment.column != "combination":
        return rows
    return rows.assign(
        x=rows["x"] + " " + rows["detector"].str.upper() + "+" + rows["descriptor"].str.upper()
    )


def _describe(sample: Sample) -> str:
    """Describe a chart in words."""
    table, rates, ratios = (
        sample.by_level("f_score"),
        sample.overall("registered"),
        sample.matches("inlier_ratio"),
    )
    best = table.mean().idxmax()
    return (
        f"{len(table.columns)} methods over {len(table)} levels, {sample.experiment.label}. On average "
        f"{method_style(best).label} has the best F, {table.mean().max():.2f}. By the paper's criterion "
        f"{_describe_rates(rates)}. The share of correct initial matches goes from {ratios.min():.3f} to "
        f"{ratios.max():.3f}."
    )


def _describe_rates(rates: pd.Series) -> str:
    """Name the methods that register the most pairs."""
    most = [method_style(method).label for method in rates.index[rates == rates.max()]]
    share = f"a share of {rates.max():.2f}"
    if len(most) == len(rates) > 1:
        return f"all methods register the same number of pairs, {share}"
    return f"{', '.join(most)} {'register' if len(most) > 1 else 'registers'} the most pairs, {share}"


def chart_pairs(evidence: Evidence, pictures: PictureBook) -> PageChart | None:
    """Chart the precision of GC and RANSAC pair by pair; None without such results."""
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
    """Chart and tabulate the times; None without times."""
    times = mean_times(timing)
    if times.empty:
        return None
    fitted = tables.exponents(timing).set_index("method")["exponent"].to_dict()
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
    """Draw the groups of each method on a pair per data set of the paper."""
    methods = sort_methods(evidence.frame["method"].unique())
    drawn: list[Picture] = []
    missing: list[str] = []
    samples = (
        evidence.sample(experiment, place, every_method=True) for place, experiment in _TYPICAL.items()
    )
    for example in (_choose_median(sample) for sample in samples if sample is not None):
        alt = f"Groups of each method on {example.dataset}, {example.pair}: lines between matched points."
        try:
            figure = draw_example(out, example, methods, root)
        except CgroupError as error:
            missing.append(f"{example.dataset}, {example.pair}: {error}")
            continue
        drawn.append(pictures.keep(f"selection-{example.place.lower()}", figure, alt))
    return Selections(drawn, missing)


def _choose_median(sample: Sample) -> Example:
    scores = sample.rows.groupby("case")["f_score"].mean().sort_values(kind="stable")
    case = scores.index[len(scores) // 2]
    row = sample.rows[sample.rows["case"] == case].iloc[0]
    return Example(sample.place, sample.dataset, row["pair"], case, row["origin"])


def draw_example(out: Path, example: Example, methods: list[str], root: Path | None = None) -> Figure:
    """Draw the group of each method in a case."""
    pair = open_dataset(example.dataset, root).load(example.pair)
    if isinstance(pair, CorrespondencePair):
        message = f"{example.dataset}: it has no clouds to draw"
        raise InputError(message)
    matches, pose, masks = tables.load_groups(out, example.case)
    tolerance = PAPER_EPSILON * (matches.resolution or np.nan)
    correct = correct_matches(matches.source, matches.target, pose, tolerance=tolerance)
    share = f"{int(correct.sum())} of {len(matches)} matches correct"
    return comparison_figure(
        pair.source.points,
        pair.target.points,
        matches,
        correct=correct,
        masks={method: masks[method] for method in methods if method in masks},
        T_target_source=pose,
        title=f"{example.dataset} ({example.origin}), {example.pair}: {share}",
    )
