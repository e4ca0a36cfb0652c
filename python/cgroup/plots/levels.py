"""Scores, registration and initial matches over the levels of an experiment."""

# Parts of matplotlib's methods are untyped. pandas ships no types, and guesses about it are often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportGeneralTypeIssues=false, reportIndexIssue=false, reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.evaluation.bins import LEAST_PAIRS
from cgroup.evaluation.protocols import PAPER_PROTOCOL, PROTOCOL_PREFIX
from cgroup.plots import style
from cgroup.plots.curves import draw_curves, finish, legend, panels, place_levels

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd
    from matplotlib.figure import Figure

    from cgroup.plots.style import MethodStyle

_SCORES = {"precision": "precision", "recall": "recall", "f_score": "F-score"}
_NAMES_HEIGHT = 0.45  # inches that names below the x axis take
_MATCHES = "#bbbbbb"


def scores_figure(
    rows: pd.DataFrame, *, xlabel: str, title: str, styles: Mapping[str, MethodStyle] | None = None
) -> Figure:
    """Draw mean precision, recall and F over the levels of an experiment, a curve per method.

    Parameters
    ----------
    rows : DataFrame
        Records with the level in the column ``x``.
    xlabel : str
        What the levels are, with the unit.
    title : str
        Shown on top.
    styles : mapping of str to MethodStyle, optional
        How methods are drawn, as `style.method_styles` chooses it for a whole report; for those of this
        figure by default.

    Returns
    -------
    Figure
        Three panels.
    """
    looks = style.method_styles(rows["method"].unique(), styles)
    few = _list_sparse(rows)
    figure, axes = panels(3, columns=3, title=title, extra=_extra(rows))
    for panel, (column, name) in zip(axes, _SCORES.items(), strict=True):
        draw_curves(panel, average_by_level(rows, column), looks, few)
        finish(panel, title=name, xlabel=xlabel, share=True)
    legend(figure, looks, few=bool(few))
    return figure


def registration_rate_figure(
    rows: pd.DataFrame, *, xlabel: str, title: str, styles: Mapping[str, MethodStyle] | None = None
) -> Figure:
    """Draw the share of registered pairs, by the paper's criterion and by each stricter one.

    Parameters
    ----------
    rows : DataFrame
        Records with the level in the column ``x``; criteria are the columns ``ok:<protocol>``.
    xlabel : str
        What the levels are, with the unit.
    title : str
        Shown on top.
    styles : mapping of str to MethodStyle, optional
        How methods are drawn, as `style.method_styles` chooses it for a whole report; for those of this
        figure by default.

    Returns
    -------
    Figure
        One panel per criterion that is applicable to some record.
    """
    named = {"registered": protocol_title(PAPER_PROTOCOL)}
    for column in rows.columns:
        if column.startswith(PROTOCOL_PREFIX) and rows[column].notna().any():
            named[column] = protocol_title(column.removeprefix(PROTOCOL_PREFIX))
    columns = len(named) if len(named) <= 3 else -(-len(named) // 2)
    looks, few = style.method_styles(rows["method"].unique(), styles), _list_sparse(rows)
    figure, axes = panels(len(named), columns=max(columns, 2), title=title, extra=_extra(rows))
    for panel, (column, name) in zip(axes, named.items(), strict=True):
        judged = rows[rows[column].notna()].astype({column: float})
        draw_curves(panel, average_by_level(judged, column), looks, few)
        finish(panel, title=name, xlabel=xlabel, share=True)
    axes[0].set_ylabel("share of pairs registered", fontsize=8, color=style.TEXT)
    legend(figure, looks, few=bool(few))
    return figure


def protocol_title(protocol: str) -> str:
    """Name a registration criterion for people."""
    return {
        PAPER_PROTOCOL: "precision > 0.1 (the paper's)",
        "rmse<=1pr": "RMSE at most 1 pr",
        "rmse<=5pr": "RMSE at most 5 pr",
        "3dmatch": "3DMatch: 15°, 0.3 m",
        "3dmatch-strict": "5°, 0.1 m",
        "kitti": "KITTI: 5°, 0.6 m",
        "kitti-2m": "5°, 2 m",
        "5deg+5pr": "5°, 5 pr over the overlap",
        "2deg+2pr": "2°, 2 pr over the overlap",
    }.get(protocol, protocol)


def inliers_figure(rows: pd.DataFrame, *, xlabel: str, title: str) -> Figure:
    """Draw how many initial matches there are, how many of them are correct, and their share.

    Parameters
    ----------
    rows : DataFrame
        Records with the level in the column ``x``.
    xlabel : str
        What the levels are, with the unit.
    title : str
        Shown on top.

    Returns
    -------
    Figure
        Two panels; means over pairs.
    """
    once = rows.drop_duplicates(["pair", "x"])
    table = once.groupby("x")[["n", "correct", "inlier_ratio"]].mean()
    pairs = once.groupby("x").size()
    figure, (counts, ratio) = panels(2, columns=2, title=title, extra=_extra(rows))
    places = list(range(len(table)))
    all_bars = counts.bar(places, table["n"], 0.7, color=_MATCHES, label="all")
    counts.bar(places, table["correct"], 0.7, color=style.CORRECT, label="correct")
    counts.bar_label(all_bars, [str(count) for count in pairs], fontsize=6.5, color=style.QUIET_TEXT)
    counts.legend(
        fontsize=7, frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1, 1), borderaxespad=0.1
    )
    named = [level if isinstance(level, str) else f"{level:g}" for level in table.index]
    place_levels(counts, named)
    finish(counts, title="initial matches", xlabel=xlabel, ylabel="mean number (on top: pairs)")
    counts.grid(visible=False, axis="x")
    places = place_levels(ratio, list(table.index))
    line = "" if isinstance(table.index[0], str) else "-"
    ratio.plot(places, table["inlier_ratio"], color=style.CORRECT, marker="o", markersize=4, linestyle=line)
    ratio.set_ylim(0, None)
    finish(ratio, title="inlier ratio", xlabel=xlabel, ylabel="share correct")
    return figure


def average_by_level(rows: pd.DataFrame, column: str) -> pd.DataFrame:
    """Mean over pairs: one row per level, one column per method."""
    return rows.pivot_table(index="x", columns="method", values=column, aggfunc="mean")


def _list_sparse(rows: pd.DataFrame) -> set[object]:
    """List the levels that have fewer pairs than tell anything."""
    pairs = rows.groupby("x")["pair"].nunique()
    return set(pairs.index[pairs < LEAST_PAIRS])


def _extra(rows: pd.DataFrame) -> float:
    return _NAMES_HEIGHT if any(isinstance(level, str) for level in rows["x"].head(1)) else 0.0
