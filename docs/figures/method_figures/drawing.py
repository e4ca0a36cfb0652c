"""Size, colours of correct and wrong matches, axes and legends of all figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from cgroup.plots.style import CORRECT, GRID, GROUPED, QUIET_TEXT, TEXT, WRONG

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from cgroup.types import BoolArray, FloatArray

WIDTH = 7.0
"""Inches; a page shows them at 600 to 800 px."""

DOTS_PER_INCH = 220
FONT = 8.5
ACCENT = GROUPED


def new_figure(height: float) -> Figure:
    """Make an empty figure of the width of a page."""
    return Figure(
        figsize=(WIDTH, height),
        dpi=DOTS_PER_INCH,
        layout=ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06, wspace=0.03, hspace=0.03),
    )


def finish(axes: Axes, *, title: str = "", xlabel: str = "", ylabel: str = "", grid: bool = True) -> None:
    """Label axes in the style of the figures."""
    axes.set_title(title, loc="left", fontsize=FONT + 0.5, color=TEXT)
    axes.set_xlabel(xlabel, fontsize=FONT, color=TEXT)
    axes.set_ylabel(ylabel, fontsize=FONT, color=TEXT)
    axes.tick_params(labelsize=FONT - 1, color=QUIET_TEXT, labelcolor=TEXT)
    if grid:
        axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(QUIET_TEXT)


def colors_of(correct: BoolArray) -> list[str]:
    """Return the colour of each match."""
    return [CORRECT if right else WRONG for right in correct]


def name_right_and_wrong(figure: Figure, *extra: Line2D | Patch, dots: bool = True) -> None:
    """Add a legend of the colours below the figure."""
    names = {"correct match": CORRECT, "wrong match": WRONG}
    handles = [
        Line2D([], [], color=color, marker="o", linestyle="", markersize=5, label=name)
        if dots
        else Patch(color=color, label=name, alpha=0.75)
        for name, color in names.items()
    ]
    name_below(figure, [*handles, *extra])


def name_below(figure: Figure, handles: Sequence[Line2D | Patch]) -> None:
    """Put a legend below the figure."""
    figure.legend(
        handles=list(handles),
        loc="outside lower center",
        ncols=min(len(handles), 6),
        frameon=False,
        fontsize=FONT,
        handlelength=1.8,
        columnspacing=1.6,
        handletextpad=0.5,
        labelcolor=TEXT,
    )


def draw_histogram(axes: Axes, values: FloatArray, correct: BoolArray, *, bins: FloatArray) -> None:
    """Draw stacked histograms of the values of correct and of wrong matches."""
    axes.hist(
        [values[~correct], values[correct]],
        bins=list(bins),
        stacked=True,
        color=[WRONG, CORRECT],
        alpha=0.8,
        rwidth=0.92,
    )


def mark_cut(axes: Axes, place: float, text: str, *, left: bool = False) -> None:
    """Mark a threshold on the x axis."""
    axes.axvline(place, color=TEXT, linewidth=1.1, linestyle=(0, (4, 2)))
    axes.annotate(
        text,
        (place, 0.97),
        xycoords=("data", "axes fraction"),
        xytext=(-4 if left else 4, 0),
        textcoords="offset points",
        ha="right" if left else "left",
        va="top",
        fontsize=FONT - 0.5,
        color=TEXT,
    )
