"""Curves over levels, one per method: what the figures of the benchmark share."""

# Parts of matplotlib's methods are untyped. pandas ships no types, and guesses about it are often wrong.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

from cgroup.evaluation.bins import LEAST_PAIRS
from cgroup.plots import style

if TYPE_CHECKING:
    from collections.abc import Container, Iterable, Mapping

    import pandas as pd
    from matplotlib.axes import Axes

    from cgroup.plots.style import MethodStyle
    from cgroup.types import BoolArray, FloatArray

MARKER_SIZE = 4.5
"""Points across a disk."""

FEW = f"fewer than {LEAST_PAIRS} pairs"
"""What hollow markers mean."""

_PANEL_HEIGHT = 2.3
_FONT = 8
_MOST_COLUMNS, _LETTERS, _HANDLE = 9, 110, 6.5  # of a legend: columns, letters that fit, those of a handle
_DOTS = (0, (1, 2.5))  # a line to levels of few pairs
_SPREAD = 0.32  # of the methods around a name
_SHORT_NAME = 4
_NAMES_TURNED = 40  # degrees, for names on the x axis


def panels(count: int, *, columns: int, title: str, extra: float = 0.0) -> tuple[Figure, list[Axes]]:
    """Make a figure of print width with panels side by side.

    Parameters
    ----------
    count : int
        Number of panels.
    columns : int
        At most so many in a row.
    title : str
        Shown on top.
    extra : float
        Inches of height that labels take.

    Returns
    -------
    tuple of Figure and list of Axes
        The axes in reading order.
    """
    rows = -(-count // columns)
    size = (style.PRINT_WIDTH, rows * (_PANEL_HEIGHT + extra) + 0.75)
    figure = Figure(
        figsize=size, dpi=style.DOTS_PER_INCH, layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05)
    )
    grid = figure.subplots(rows, min(columns, count), squeeze=False).reshape(-1)
    for axes in grid[count:]:
        axes.set_axis_off()
    figure.suptitle(title, color=style.TEXT, fontsize=_FONT + 1.5)
    return figure, list(grid[:count])


def draw_curves(
    axes: Axes, table: pd.DataFrame, looks: Mapping[str, MethodStyle], few: Container[object] = ()
) -> None:
    """Draw one curve per method.

    Parameters
    ----------
    axes : Axes
        Where to.
    table : DataFrame
        One row per level, ascending, one column per method. Levels that are names have no order, so that
        nothing connects them, and the methods stand side by side.
    looks : mapping of str to MethodStyle
        Of each method.
    few : container
        Levels that have too few pairs for a curve: their markers are hollow, and the lines to them dotted.
    """
    levels = list(table.index)
    sparse = np.array([level in few for level in levels], dtype=bool)
    places = np.array(place_levels(axes, levels), dtype=np.float64)
    named = isinstance(levels[0], str)
    methods = [method for method in sort_methods(looks) if method in table.columns]
    aside = np.linspace(-_SPREAD, _SPREAD, len(methods)) if named else np.zeros(len(methods))
    for method, shift in zip(methods, aside, strict=True):
        look, heights = looks[method], table[method].to_numpy(dtype=float)
        if not named:
            _connect(axes, places, heights, look, sparse)
        for hollow in (False, True):
            if (sparse == hollow).any():
                axes.plot(
                    places + shift,
                    heights,
                    color=look.color,
                    marker=look.marker,
                    markevery=np.flatnonzero(sparse == hollow).tolist(),
                    linestyle="",
                    markersize=marker_size(look),
                    markerfacecolor="white" if hollow else look.color,
                    markeredgecolor=look.color if hollow else "white",
                    markeredgewidth=0.9 if hollow else 0.4,
                    clip_on=False,
                    zorder=3,
                )


def _connect(
    axes: Axes, places: FloatArray, heights: FloatArray, look: MethodStyle, sparse: BoolArray
) -> None:
    """Connect neighbouring levels, by a dotted line where either has few pairs."""
    dotted = np.flatnonzero(sparse[:-1] | sparse[1:])
    x, y = (np.insert(values, dotted + 1, np.nan) for values in (places, heights))  # a gap for each
    lines = axes.plot(x, y, linestyle=look.dashes, linewidth=1.1)
    for start in dotted:
        two = slice(start, start + 2)
        lines += axes.plot(places[two], heights[two], linestyle=_DOTS, linewidth=0.7)
    for line in lines:
        line.set(color=look.color, clip_on=False, zorder=3)


def place_levels(axes: Axes, levels: list[float] | list[str]) -> list[float]:
    """Find where levels stand on the x axis, and name them there if they are names."""
    if not levels or not isinstance(levels[0], str):
        return [float(level) for level in levels]
    places = [float(place) for place in range(len(levels))]
    axes.set_xticks(places, [str(level) for level in levels])
    axes.set_xlim(-0.6, len(levels) - 0.4)
    if max(len(str(level)) for level in levels) > _SHORT_NAME:
        for label in axes.get_xticklabels():
            label.set(rotation=_NAMES_TURNED, horizontalalignment="right", rotation_mode="anchor")
    return places


def finish(axes: Axes, *, title: str = "", xlabel: str = "", ylabel: str = "", share: bool = False) -> None:
    """Label a panel; the y axis of a share goes from 0 to 1."""
    axes.set_title(title, loc="left", fontsize=_FONT + 0.5, color=style.TEXT)
    axes.set_xlabel(xlabel, fontsize=_FONT, color=style.TEXT)
    axes.set_ylabel(ylabel, fontsize=_FONT, color=style.TEXT)
    axes.tick_params(labelsize=_FONT - 1, color=style.QUIET_TEXT, labelcolor=style.TEXT)
    axes.grid(color=style.GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(style.QUIET_TEXT)
    if share:
        axes.set_ylim(0, 1)
        axes.set_yticks(np.linspace(0, 1, 6))


def legend(figure: Figure, looks: Mapping[str, MethodStyle], *, few: bool = False) -> None:
    """Name the methods below all panels, and say what hollow markers are if there are levels of few pairs."""
    handles = [
        Line2D(
            [],
            [],
            color=look.color,
            marker=look.marker,
            linestyle=look.dashes,
            linewidth=1.1,
            markersize=marker_size(look),
            label=style.as_it_is(look.label),
        )
        for look in (looks[method] for method in sort_methods(looks))
    ]
    if few:
        hollow = Line2D([], [], color=style.QUIET_TEXT, marker="o", markerfacecolor="white", label=FEW)
        hollow.set(linestyle=_DOTS, linewidth=0.7, markersize=MARKER_SIZE)
        handles.append(hollow)
    figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=_count_columns([len(str(handle.get_label())) for handle in handles]),
        frameon=False,
        fontsize=_FONT,
        handlelength=2.4,
        columnspacing=1.1,
        handletextpad=0.4,
    )


def _count_columns(lengths: list[int]) -> int:
    """Count the columns of names that stand beside each other; names of so many letters fill them in turn."""
    for count in range(min(len(lengths), _MOST_COLUMNS), 1, -1):
        width = sum(max(column) for column in np.array_split(lengths, count)) + count * _HANDLE
        if width <= _LETTERS:
            return count
    return 1


def sort_methods(methods: Iterable[str]) -> list[str]:
    """Sort methods: the paper's order, then any others."""
    known = list(style.METHOD_STYLES)
    return sorted(methods, key=lambda name: known.index(name) if name in known else len(known))


def marker_size(look: MethodStyle) -> float:
    """Size of a marker in points."""
    return MARKER_SIZE * look.size
