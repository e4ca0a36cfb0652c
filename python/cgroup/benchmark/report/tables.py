"""The report's tables."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

from cgroup.benchmark.paper import PAPER_COMPLEXITY
from cgroup.benchmark.paper.checks import TIE
from cgroup.benchmark.report.cells import MISSING, Cell, Table, method_cell, number, words
from cgroup.benchmark.tables import aggregate
from cgroup.evaluation.protocols import PROTOCOL_PREFIX
from cgroup.plots.experiments import protocol_title
from cgroup.plots.style import method_style

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import pandas as pd

    from cgroup.benchmark.paper.evidence import Sample


def ranking_table(sample: Sample) -> Table:
    """Rank the methods in one experiment, by F."""
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


def score_table(samples: Iterable[Sample], how: Literal["macro", "pooled", "median"]) -> Table:
    """List the scores of every method in every experiment."""
    tables = [(sample, aggregate(sample.rows, by=["method"], how=how)) for sample in samples]
    columns = {name for _, table in tables for name in table.columns}
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
        for sample, table in tables
        for _, row in _sort_by_paper(table).iterrows()
    ]
    titles = [protocol_title(name.removeprefix(PROTOCOL_PREFIX)) for name in protocols]
    headers = ("experiment", "data set", "method", "records", "P", "R", "F", "registered", *titles)
    captions = {
        "macro": "Means over pairs, each with the same weight",
        "pooled": "All matches of all pairs taken as one set",
        "median": "Medians over pairs (shares of registered pairs stay means)",
    }
    return Table(captions[how], headers, rows)


def timing_table(times: pd.DataFrame, fitted: Mapping[str, float]) -> Table:
    """List mean times, and fitted exponents beside the paper's complexities."""
    rows = [
        (
            method_cell(method),
            words(PAPER_COMPLEXITY.get(method, MISSING)),
            number(fitted.get(method, math.nan), "{:.2f}"),
            *(_format_milliseconds(times.loc[n, method]) for n in times.index),
        )
        for method in times.columns
    ]
    headers = ("method", "paper", "measured exponent", *(f"n {n:,} (ms)" for n in times.index))
    rows.sort(key=lambda row: row[0].key)
    return Table("Mean milliseconds per grouping on one thread", headers, rows)


def dataset_table(frame: pd.DataFrame, known: pd.DataFrame) -> Table:
    """List the data sets that the records come from."""
    about = known.set_index("name").to_dict("index")
    rows: list[tuple[Cell, ...]] = []
    for name, of_set in frame.groupby("dataset", sort=False):
        facts = about.get(name, {})
        cases = of_set.drop_duplicates("case")
        origins = of_set.drop_duplicates("pair").groupby("origin").size()
        rows.append(
            (
                words(name),
                words(facts.get("title", MISSING)),
                words(facts.get("role", MISSING)),
                words(", ".join(f"{origin} ({count})" for origin, count in origins.items())),
                number(of_set["pair"].nunique(), "{:.0f}"),
                number(len(cases), "{:.0f}"),
                number(cases["n"].mean(), "{:.0f}"),
                words(facts.get("citation", MISSING)),
            )
        )
    headers = ("name", "data set", "role", "origin (pairs)", "pairs", "cases", "mean matches", "citation")
    return Table("Data sets", headers, rows)


def failure_table(
    frame: pd.DataFrame, registrations: pd.DataFrame, scenes: pd.DataFrame, trials: pd.DataFrame
) -> Table:
    """List what failed, with the error."""
    rows = _list_failures(frame, "method", "case") if len(frame) else []
    rows += _list_failures(registrations, "pipeline", "pair") if len(registrations) else []
    rows += _list_failures(scenes, "solver", "pair") if len(scenes) else []
    rows += _list_failures(trials, "method", "case") if len(trials) else []
    headers = ("data set", "error", "methods or solvers", "cases", "for example")
    return Table("Failures", headers, rows)


def _list_failures(frame: pd.DataFrame, method: str, case: str) -> list[tuple[Cell, ...]]:
    failed = frame[frame["error"] != ""]
    return [
        (
            words(dataset),
            words(error),
            words(", ".join(method_style(name).label for name in of_it[method].unique())),
            number(of_it[case].nunique(), "{:.0f}"),
            words(of_it["pair"].iloc[0]),
        )
        for (dataset, error), of_it in failed.groupby(["dataset", "error"], sort=False)
    ]


def plain_table(caption: str, frame: pd.DataFrame, headers: Sequence[str] = ()) -> Table:
    """List a frame as it is."""
    rows = [tuple(words(value) for value in row) for row in frame.itertuples(index=False)]
    return Table(caption, tuple(headers) or tuple(map(str, frame.columns)), rows)


def _format_milliseconds(seconds: float) -> Cell:
    value = 1e3 * seconds
    return number(value, "{:,.0f}" if value >= 100 else "{:.3g}")


def _mark_best(scores: pd.Series, method: str) -> Cell:
    cell = number(float(scores[method]))
    return cell._replace(best=bool(scores[method] >= scores.max() - TIE))


def _sort_by_paper(table: pd.DataFrame) -> pd.DataFrame:
    return table.iloc[sorted(range(len(table)), key=lambda row: method_cell(table["method"].iloc[row]).key)]
