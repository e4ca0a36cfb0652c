"""Verdicts on claims under several readings of the paper."""

# Parts of matplotlib's methods are untyped. pandas ships no types, and guesses about it are often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch, Rectangle

from cgroup.plots import style

if TYPE_CHECKING:
    import pandas as pd

VERDICT_COLORS = {
    "confirmed": "#117733",
    "partly": "#DDCC77",
    "not confirmed": "#CC6677",
    "not testable": "#BBBBBB",
}
"""Of Paul Tol's scheme "muted", which stays distinct for colour-blind readers."""

_CELL = 0.155  # inches
_ROW_LABELS, _COLUMN_LABELS, _LEGEND = 0.55, 1.35, 0.55
_INSET = 0.07  # of a cell, left white around it
_UNMOVED = 0.28  # opacity


def draw_readings(rows: pd.DataFrame, *, title: str) -> Figure:
    """Draw the verdict on every claim under every reading."""
    readings = list(dict.fromkeys(zip(rows["group"], rows["reading"], strict=True)))
    claims = list(dict.fromkeys(rows["claim"]))
    places = _place_columns([group for group, _ in readings])
    width, height = (places[-1] + 1) * _CELL, len(claims) * _CELL
    size = (max(width + _ROW_LABELS + 0.1, 4.0), height + _COLUMN_LABELS + _LEGEND)
    figure = Figure(figsize=size, dpi=style.DOTS_PER_INCH)
    axes = figure.add_axes((_ROW_LABELS / size[0], _LEGEND / size[1], width / size[0], height / size[1]))
    at = dict(zip(readings, places, strict=True))
    down = {claim: i for i, claim in enumerate(claims)}
    usual = {row.claim: row.verdict for row in rows.itertuples() if (row.group, row.reading) == readings[0]}
    for row in rows.itertuples():
        framed = row.verdict != usual.get(row.claim, row.verdict)
        _draw_cell(axes, at[row.group, row.reading], down[row.claim], row, framed=framed)
    _label(axes, [name for _, name in readings], places, claims)
    figure.text(0.02, 1 - 0.16 / size[1], title, fontsize=9, weight="bold", color=style.TEXT, va="center")
    _explain(figure)
    return figure


def _place_columns(groups: list[str]) -> list[float]:
    """Columns side by side, with a gap between groups."""
    places: list[float] = []
    at = 0.0
    for i, group in enumerate(groups):
        at += 0.5 if i and group != groups[i - 1] else 0.0
        places.append(at)
        at += 1.0
    return places


def _draw_cell(axes: Axes, x: float, y: int, row: pd.Series, *, framed: bool) -> None:
    size = 1 - 2 * _INSET
    alpha = 1.0 if row.moved else _UNMOVED
    color, edge = VERDICT_COLORS[row.verdict], style.TEXT if framed else "none"
    axes.add_patch(Rectangle((x, y), size, size, facecolor=color, edgecolor=edge, alpha=alpha, linewidth=0.9))
    if row.close:
        middle = size / 2
        axes.plot(x + middle, y + middle, ".", color=style.TEXT, markersize=2.2, alpha=max(alpha, 0.5))


def _label(axes: Axes, readings: list[str], places: list[float], claims: list[str]) -> None:
    middle = 0.5 - _INSET
    axes.set_xlim(-_INSET, places[-1] + 1 - _INSET)
    axes.set_ylim(len(claims) - _INSET, -_INSET)
    axes.set_xticks([x + middle for x in places], [style.as_it_is(name) for name in readings], rotation=90)
    axes.set_yticks([y + middle for y in range(len(claims))], claims)
    axes.tick_params(length=0, labelsize=6, labelcolor=style.TEXT, pad=2, labeltop=True, labelbottom=False)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _explain(figure: Figure) -> None:
    handles = [Patch(color=color, label=verdict) for verdict, color in VERDICT_COLORS.items()]
    handles.append(Patch(color=style.QUIET_TEXT, alpha=_UNMOVED, label="pale: not moved"))
    handles.append(Patch(facecolor="none", edgecolor=style.TEXT, label="framed: not as by default"))
    dot = figure.axes[0].plot([], [], ".", color=style.TEXT, markersize=4, label="dot: close")
    figure.legend(
        handles=[*handles, *dot], loc="lower left", ncols=3, fontsize=6, frameon=False, handlelength=1.0,
        columnspacing=1.2, bbox_to_anchor=(0.0, 0.0),
    )  # fmt: skip
