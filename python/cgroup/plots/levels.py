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
    """Draw mean precision, recall and F over the levels of an experiment.

    Parameters
    ----------
    rows : DataFrame
        Records with the columns ``pair``, ``method``, ``precision``, ``recall``, ``f_score``, and the level
        in ``x``.
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
        Three panels, a curve per method.

    Raises
    ------
    KeyError
        For records that lack a column.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.plots import scores_figure
    >>> rows = pd.DataFrame(
    ...     {"method": ["gtm"] * 3, "x": [0.1, 0.2, 0.3], "precision": [1.0, 0.9, 0.8]}
    ... )
    >>> rows = rows.assign(recall=0.5, f_score=0.6, pair="a")
    >>> figure = scores_figure(rows, xlabel="noise (pr)", title="Noise")
    >>> [axes.get_title(loc="left") for axes in figure.axes]
    ['precision', 'recall', 'F-score']
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
    """Draw the share of registered pairs over the levels, by each criterion.

    Parameters
    ----------
    rows : DataFrame
        Records with the columns ``pair``, ``method``, ``registered`` (by the paper's criterion), and the
        level in ``x``; stricter criteria are the columns ``ok:<protocol>``.
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

    Raises
    ------
    KeyError
        For records that lack a column.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.plots import registration_rate_figure
    >>> rows = pd.DataFrame(
    ...     {"method": "gtm", "x": [0.1, 0.2, 0.3], "registered": [True, True, False]}
    ... )
    >>> rows = rows.assign(pair="a")
    >>> figure = registration_rate_figure(rows, xlabel="noise (pr)", title="Noise")
    >>> figure.axes[0].get_title(loc="left")
    "precision > 0.1 (the paper's)"
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
    """Draw how many initial matches there are over the levels, and how many are right.

    Parameters
    ----------
    rows : DataFrame
        Records with the columns ``pair``, ``n``, ``correct``, ``inlier_ratio``, and the level in ``x``.
    xlabel : str
        What the levels are, with the unit.
    title : str
        Shown on top.

    Returns
    -------
    Figure
        Two panels, numbers and shares; means over pairs.

    Raises
    ------
    KeyError
        For records that lack a column.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.plots import inliers_figure
    >>> rows = pd.DataFrame(
    ...     {"pair": "a", "x": [0.1, 0.2], "n": 1000, "correct": [300, 200]}
    ... )
    >>> rows = rows.assign(inlier_ratio=rows["correct"] / rows["n"])
    >>> figure = inliers_figure(rows, xlabel="noise (pr)", title="Matches")
    >>> [axes.get_title(loc="left") for axes in figure.axes]
    ['initial matches', 'inlier ratio']
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
