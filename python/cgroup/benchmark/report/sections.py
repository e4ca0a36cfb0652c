"""Sections of the report on experiments and times: charts, rankings, all scores, standings over all pairs."""

import json
import math
from collections.abc import Iterable, Mapping
from typing import Any

import pandas as pd

from cgroup.benchmark import tables
from cgroup.benchmark.paper import PAPER_COMPLEXITY, PAPER_EPSILON, Experiment
from cgroup.benchmark.paper.evidence import Evidence, Sample, mean_times
from cgroup.benchmark.paper.numbers import TIE
from cgroup.benchmark.report import curves
from cgroup.benchmark.report.cells import MISSING, Cell, Table, method_cell, milliseconds, number, words
from cgroup.benchmark.report.charts import FigureFiles, PageChart, Section
from cgroup.benchmark.stats import Overall, Standing, rank_overall
from cgroup.evaluation.protocols import LEAST_PAIRS, PROTOCOL_PREFIX
from cgroup.plots.charts import Chart
from cgroup.plots.style import method_style

_MEASURES = {"f_score": "mean F", "registered": "registered"}  # of standings


def make_sections(experiment: Experiment, evidence: Evidence, figures: FigureFiles) -> list[Section]:
    """Make a section for each data set of the paper with results of an experiment."""
    samples = (
        (place, evidence.sample(experiment.id, place, every_method=True)) for place in experiment.places
    )
    return [
        _make_section(sample, f"{experiment.id}-{place.lower()}", f"{place}: {sample.description}", figures)
        for place, sample in samples
        if sample is not None
    ]


def make_own_section(sample: Sample, figures: FigureFiles) -> Section:
    """Make the section of an experiment that is not the paper's."""
    anchor = "".join(c if c.isalnum() else "-" for c in f"{sample.experiment.id}-{sample.dataset}").lower()
    title = f"{sample.experiment.id}: {sample.description}{_describe_front(sample)}"
    return _make_section(sample, anchor, title, figures)


def _describe_front(sample: Sample) -> str:
    """Return the changes of an experiment to the front end in words; "" if there are none."""
    changes: dict[str, object] = {}
    for text in set(sample.rows["front"]) - {""}:
        changes |= json.loads(text)
    shown = ", ".join(f"{name} {json.dumps(value)}" for name, value in sorted(changes.items()))
    return f"; front end: {shown}".replace('"', "") if shown else ""


def _make_section(sample: Sample, anchor: str, title: str, figures: FigureFiles) -> Section:
    chart = _chart_experiment(sample, anchor, figures) if sample.rows["x"].notna().any() else None
    return Section(title, [ranking_table(sample)], chart, anchor)


def _chart_experiment(sample: Sample, anchor: str, figures: FigureFiles) -> PageChart:
    experiment, rows = sample.experiment, _name_combinations(sample)
    by_method = rows, experiment.label, figures.styles
    charts = {
        "scores": curves.scores_chart(*by_method),
        "registration": curves.rates_chart(*by_method),
    }
    if experiment.id != "epsilon":  # the same matches at each threshold
        charts["inliers"] = curves.matches_chart(rows, experiment.label)
    title = f"{experiment.title}: {sample.description}"
    files = tuple(
        figures.save(f"{anchor}-{name}", chart.draw(title, columns=min(3, len(chart.panels))))
        for name, chart in charts.items()
    )
    looks = {key: look for chart in charts.values() for key, look in chart.looks.items()}
    joined = Chart([panel for chart in charts.values() for panel in chart.panels], looks)
    return PageChart(anchor, _describe(sample), joined, files)


def _name_combinations(sample: Sample) -> pd.DataFrame:
    rows = sample.rows
    if sample.experiment.column != "combination":
        return rows
    return rows.assign(
        x=rows["x"] + " " + rows["detector"].str.upper() + "+" + rows["descriptor"].str.upper()
    )


def _describe(sample: Sample) -> str:
    means = sample.by_level("f_score")
    best = means.mean().idxmax()
    return (
        f"{len(means.columns)} methods over {len(means)} levels, {sample.experiment.label}. On average "
        f"{method_style(best).label} has the best F, {means.mean().max():.2f}."
    )


def chart_times(timing: pd.DataFrame, figures: FigureFiles) -> Section | None:
    """Chart and tabulate the times; None without times."""
    times = mean_times(timing)
    if times.empty:
        return None
    fitted = tables.exponents(timing).set_index("method")["exponent"].to_dict()
    sources = ", ".join(timing["dataset"].unique())
    shown: dict[str, Any] = {"exponents": fitted, "complexities": PAPER_COMPLEXITY, "styles": figures.styles}
    file = figures.save("time", curves.draw_times(times, **shown, title=f"Time per grouping, {sources}"))
    last = times.iloc[-1].dropna()
    alt = (
        f"Mean time of {len(times.columns)} methods over the number of matches of {sources}, logarithmic "
        f"axes; at n {times.index[-1]:,} {method_style(last.idxmin()).label} is the fastest, "
        f"{method_style(last.idxmax()).label} the slowest."
    )
    chart = PageChart(file, alt, curves.times_chart(times, **shown), (file,))
    return Section("Time", [timing_table(times, fitted)], chart)


def ranking_table(sample: Sample) -> Table:
    """Rank the methods of an experiment by F."""
    columns = {"f_score": "F", "precision": "P", "recall": "R", "registered": "registered"}
    scores = {column: sample.overall(column) for column in columns}
    order = scores["f_score"].sort_values(ascending=False, kind="stable").index
    rows = [
        (
            Cell(str(rank), float(rank)),
            method_cell(str(method)),
            *(_mark_best(scores[column], str(method)) for column in columns),
        )
        for rank, method in enumerate(order, start=1)
    ]
    return Table("Ranking by F, mean over all levels and pairs", ("rank", "method", *columns.values()), rows)


def score_table(samples: Iterable[Sample]) -> Table:
    """Tabulate the scores of every method in every experiment."""
    means = [(sample, tables.aggregate(sample.rows, by=["method"])) for sample in samples]
    columns = {name for _, table in means for name in table.columns}
    protocols = sorted(name for name in columns if name.startswith(PROTOCOL_PREFIX))
    rows = [
        (
            words(sample.experiment.title),
            words(sample.dataset),
            method_cell(row["method"]),
            number(row["pairs"], "{:.0f}"),
            *(number(row[name]) for name in ("precision", "recall", "f_score", "registered")),
            *(number(row.get(name, math.nan)) for name in protocols),
        )
        for sample, table in means
        for _, row in sorted(table.iterrows(), key=lambda each: method_cell(each[1]["method"]).key)
    ]
    titles = [curves.protocol_title(name.removeprefix(PROTOCOL_PREFIX)) for name in protocols]
    headers = ("experiment", "data set", "method", "records", "P", "R", "F", "registered", *titles)
    return Table("Means over pairs, each with the same weight", headers, rows)


def timing_table(times: pd.DataFrame, fitted: Mapping[str, float]) -> Table:
    """Tabulate mean times, and fitted exponents beside the paper's complexities."""
    rows = [
        (
            method_cell(method),
            words(PAPER_COMPLEXITY.get(method, MISSING)),
            number(fitted.get(method, math.nan), "{:.2f}"),
            *(milliseconds(times.loc[n, method]) for n in times.index),
        )
        for method in times.columns
    ]
    headers = ("method", "paper", "measured exponent", *(f"n {n:,} (ms)" for n in times.index))
    rows.sort(key=lambda row: row[0].key)
    return Table("Mean milliseconds per grouping on one thread", headers, rows)


def _mark_best(scores: pd.Series, method: str) -> Cell:
    cell = number(float(scores[method]))
    return cell._replace(best=bool(scores[method] >= scores.max() - TIE))


def make_standings(frame: pd.DataFrame) -> list[tuple[Overall, Table]]:
    """Rank methods on the experiments at the paper's threshold, without cases that failed for all."""
    if frame.empty:
        return []
    rows = frame[(frame["epsilon"] - PAPER_EPSILON).abs() < 1e-9]
    rows = rows[rows["case"].isin(rows.loc[rows["error"] == "", "case"])]
    return [(overall, _rank(overall)) for overall in rank_overall(rows, tuple(_MEASURES))]


def _rank(overall: Overall) -> Table:
    certain = overall.units >= LEAST_PAIRS
    lines: list[tuple[Cell, ...]] = []
    for place, method in enumerate(overall.methods, start=1):
        cells = [cell for of in overall.standings.values() for cell in _show(of, method, certain=certain)]
        lines.append((Cell(str(place), float(place)), method_cell(method), *cells))
    names = [_MEASURES[measure] for measure in overall.standings]
    headers = [header for name in names for header in ((name, "p") if certain else (name,))]
    return Table(f"Ranking by {names[0]}", ("rank", "method", *headers), lines)


def _show(standings: dict[str, Standing], method: str, *, certain: bool) -> tuple[Cell, ...]:
    """Return the cells of a mean, and of the p of its difference from the highest."""
    (mean, low, high), p, tied = standings[method]
    if not certain:
        return (Cell(f"{mean:.3f}", mean),)
    text = f"{mean:.3f} [{low:.2f}, {high:.2f}]"
    highest = mean == max(each.interval.mean for each in standings.values())
    return (
        Cell(text, mean, best=tied, interval=(mean, low, high)),
        Cell(MISSING if highest else "< 0.001" if p < 0.001 else f"{p:.3f}", p),
    )
