"""Charts of experiments: scores, registration and initial matches over levels, with intervals."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup.benchmark.report.charts import Chart, Look, Panel, Series, look_up
from cgroup.benchmark.stats import Interval, bootstrap, name_units
from cgroup.evaluation.bins import LEAST_PAIRS
from cgroup.evaluation.protocols import PAPER_PROTOCOL, PROTOCOL_PREFIX
from cgroup.plots.curves import sort_methods
from cgroup.plots.levels import protocol_title
from cgroup.plots.style import CORRECT, QUIET_TEXT

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd

    from cgroup.plots.style import MethodStyle

_SCORES = {"f_score": "F", "precision": "precision", "recall": "recall"}
_UNKNOWN = Interval(math.nan, math.nan, math.nan)


class Estimate(NamedTuple):
    """A mean over pairs.

    Attributes
    ----------
    interval : Interval
        NaN in its ends where there are too few pairs for any.
    pairs : int
        Of how many pairs.
    """

    interval: Interval
    pairs: int


def scores_chart(
    name: str,
    rows: pd.DataFrame,
    *,
    x_title: str,
    alt: str,
    files: tuple[str, ...],
    styles: Mapping[str, MethodStyle],
) -> Chart:
    """Chart scores, registration by every criterion, and initial matches over levels.

    Parameters
    ----------
    name : str
        Of the chart.
    rows : DataFrame
        Records with the level in the column ``x``.
    x_title : str
        What the levels are, with the unit.
    alt : str
        What the chart shows.
    files : tuple of str
        Figures of the same.
    styles : mapping of str to MethodStyle
        Of the whole report.

    Returns
    -------
    Chart
        A panel per score and criterion, with a series per method, and two of the matches.
    """
    criteria = {"registered": f"registered: {protocol_title(PAPER_PROTOCOL)}"}
    for column in rows.columns:
        if column.startswith(PROTOCOL_PREFIX) and rows[column].notna().any():
            criteria[column] = f"registered: {protocol_title(column.removeprefix(PROTOCOL_PREFIX))}"
    titles = _SCORES | criteria
    levels = sorted(rows["x"].dropna().unique().tolist())
    by_level = [estimate_means(rows[rows["x"] == level], tuple(titles)) for level in levels]
    methods = sort_methods(rows["method"].unique())
    panels = [
        Panel(
            title.removeprefix("registered: ") if column != "registered" else "registered",
            x_title,
            f"mean {title}" if column in _SCORES else f"share of pairs {title}",
            [make_series(method, [of[column].get(method) for of in by_level]) for method in methods],
            at=levels,
        )
        for column, title in titles.items()
    ]
    looks = look_up(methods, styles) | {
        "all": Look("all", QUIET_TEXT, "square"),
        "correct": Look("correct", CORRECT),
    }
    return Chart(name, alt, panels + _match_panels(rows, levels, x_title), looks, files)


def estimate_means(rows: pd.DataFrame, columns: tuple[str, ...]) -> dict[str, dict[str, Estimate]]:
    """Find means over pairs with their intervals.

    Parameters
    ----------
    rows : DataFrame
        `dataset, pair, method` and the columns, at one level.
    columns : tuple of str
        Numbers or flags; missing ones don't count.

    Returns
    -------
    dict of str to dict of str to Estimate
        By column and method.
    """
    pairs = rows[["dataset", "pair"]].drop_duplicates()
    units = dict(zip(zip(pairs["dataset"], pairs["pair"], strict=True), name_units(pairs), strict=True))
    keys = [units[key] for key in zip(rows["dataset"], rows["pair"], strict=True)]
    values = rows[list(columns)].astype(float).assign(unit=keys, method=rows["method"].to_numpy())
    grouped = values.groupby(["unit", "method"], sort=False)
    sums, counts = (table.unstack("method").fillna(0.0) for table in (grouped.sum(), grouped.count()))  # noqa: PD010 - of a sum
    numbers = rows.groupby("method")["pair"].nunique()
    intervals = bootstrap(sums.to_numpy(np.float64), counts.to_numpy(np.float64))
    found: dict[str, dict[str, Estimate]] = {column: {} for column in columns}
    for (column, method), interval in zip(sums.columns, intervals, strict=True):
        several = numbers[method] >= LEAST_PAIRS and len(sums) >= LEAST_PAIRS
        known = interval if several else Interval(interval.mean, math.nan, math.nan)
        found[column][method] = Estimate(known, int(numbers[method]))
    return found


def make_series(key: str, estimates: list[Estimate | None]) -> Series:
    """Make a series of what was estimated at each level; None where nothing was."""
    intervals = [_UNKNOWN if each is None else each.interval for each in estimates]
    return Series(
        key,
        y=[each.mean for each in intervals],
        low=[each.low for each in intervals],
        high=[each.high for each in intervals],
        counts=[0 if each is None else each.pairs for each in estimates],
    )


def _match_panels(rows: pd.DataFrame, levels: list[float] | list[str], x_title: str) -> list[Panel]:
    """Show the initial matches, which no method has a part in."""
    once = rows.drop_duplicates(["dataset", "pair", "x"]).assign(method="all")
    columns = ("n", "correct", "inlier_ratio")
    by_level = [estimate_means(once[once["x"] == level], columns) for level in levels]
    numbers = [
        make_series(key, [of[column].get("all") for of in by_level])
        for key, column in (("all", "n"), ("correct", "correct"))
    ]
    ratio = make_series("correct", [of["inlier_ratio"].get("all") for of in by_level])
    return [
        Panel("matches", x_title, "initial matches (mean)", numbers, at=levels, share=False),
        Panel("inlier ratio", x_title, "share of the initial matches", [ratio], at=levels, share=False),
    ]
