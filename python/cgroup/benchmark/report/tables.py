"""Tables of the report on experiments, times, data sets and failures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Literal

from cgroup.benchmark.paper import PAPER_COMPLEXITY
from cgroup.benchmark.paper.evidence import Sample
from cgroup.benchmark.paper.numbers import TIE
from cgroup.benchmark.report.cells import (
    MISSING,
    Cell,
    Table,
    method_cell,
    milliseconds,
    number,
    tabulate,
    words,
)
from cgroup.benchmark.tables import aggregate
from cgroup.evaluation.protocols import PROTOCOL_PREFIX
from cgroup.plots.experiments import protocol_title
from cgroup.plots.style import method_style

if TYPE_CHECKING:  # slow to load
    import pandas as pd


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


def score_table(samples: Iterable[Sample], how: Literal["macro", "pooled", "median"]) -> Table:
    """Tabulate the scores of every method in every experiment."""
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
        "pooled": "All matches of all pairs as one set",
        "median": "Medians over pairs (shares of registered pairs stay means)",
    }
    return Table(captions[how], headers, rows)


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


def dataset_table(frame: pd.DataFrame, known: pd.DataFrame) -> Table:
    """Tabulate the data sets of the experiments."""
    about = known.set_index("name").to_dict("index")

    def fact(rows: pd.DataFrame, name: str) -> Cell:
        return words(about.get(rows["dataset"].iloc[0], {}).get(name, MISSING))

    def origins(rows: pd.DataFrame) -> Cell:
        counts = rows.drop_duplicates("pair").groupby("origin").size()
        return words(", ".join(f"{origin} ({count})" for origin, count in counts.items()))

    columns = {
        "data set": lambda rows: fact(rows, "title"),
        "role": lambda rows: fact(rows, "role"),
        "origin (pairs)": origins,
        "pairs": lambda rows: number(rows["pair"].nunique(), "{:.0f}"),
        "cases": lambda rows: number(rows["case"].nunique(), "{:.0f}"),
        "mean matches": lambda rows: number(rows.drop_duplicates("case")["n"].mean(), "{:.0f}"),
        "citation": lambda rows: fact(rows, "citation"),
    }
    return tabulate("Data sets", frame, {"dataset": "name"}, columns)


def failure_table(frames: Iterable[pd.DataFrame]) -> Table:
    """Tabulate errors."""
    columns = {
        "methods or solvers": lambda rows: words(
            ", ".join(method_style(name).label for name in rows["method"].unique())
        ),
        "cases": lambda rows: number(rows["case"].nunique(), "{:.0f}"),
        "for example": lambda rows: words(rows["pair"].iloc[0]),
    }
    by = {"dataset": "data set", "error": "error"}
    failed = [each[each["error"] != ""] for each in frames if len(each)]
    found = [tabulate("Failures", each, by, columns) for each in failed]
    return Table("Failures", (*by.values(), *columns), [row for each in found for row in each.rows])


def plain_table(caption: str, frame: pd.DataFrame) -> Table:
    """Tabulate a frame as it is."""
    rows = [tuple(words(value) for value in row) for row in frame.itertuples(index=False)]
    return Table(caption, tuple(map(str, frame.columns)), rows)


def _mark_best(scores: pd.Series, method: str) -> Cell:
    cell = number(float(scores[method]))
    return cell._replace(best=bool(scores[method] >= scores.max() - TIE))


def _sort_by_paper(table: pd.DataFrame) -> pd.DataFrame:
    return table.iloc[sorted(range(len(table)), key=lambda row: method_cell(table["method"].iloc[row]).key)]
