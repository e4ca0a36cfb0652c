"""What each main option changes: precision, recall, F and time over its values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

from cgroup.plots.style import QUIET_TEXT, TEXT
from method_figures.drawing import FONT, finish, name_below, new_figure
from method_figures.measured import load_options
from method_figures.sweeps import DATA, SWEEPS, Sweep

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

CURVES = {
    "precision": ("precision", "#0072B2", "s"),
    "recall": ("recall", "#E69F00", "^"),
    "f_score": ("F", "#000000", "o"),
}
_DASHES = ("-", (0, (4, 1.6)))
_WORTH_SHOWING = 0.1  # ms


def draw_options(method: str) -> Figure:
    """Draw one column per option of a method: two kinds of data, and the time unless it is next to none."""
    sweeps = [sweep for sweep in SWEEPS if sweep.method == method]
    timed = bool((load_options().query("method == @method")["milliseconds"] > _WORTH_SHOWING).any())
    figure = new_figure(6.2 if timed else 4.5)
    parts = figure.subfigures(
        3 if timed else 2, 1, height_ratios=(1.14, 1.14, 1) if timed else (1, 1), hspace=0.0
    )
    for part, data in zip(parts, sweeps[0].data, strict=False):
        _name_part(part, DATA[data])
        for axes, sweep in zip(_row(part, len(sweeps)), sweeps, strict=True):
            _draw_scores(axes, sweep, _rows(sweep, data), first=sweep is sweeps[0])
    if timed:
        _name_part(parts[2], "Time")
        for axes, sweep in zip(_row(parts[2], len(sweeps)), sweeps, strict=True):
            _draw_times(axes, sweep, first=sweep is sweeps[0])
    _name_curves(figure, timed=timed)
    return figure


def _name_part(part: SubFigure, text: str) -> None:
    part.suptitle(text, x=0.01, ha="left", fontsize=FONT + 0.5, color=TEXT, fontweight="bold")


def _name_curves(figure: Figure, *, timed: bool) -> None:
    handles = [
        Line2D([], [], color=color, marker=marker, markersize=4.5, linewidth=1.4, label=label)
        for label, color, marker in CURVES.values()
    ]
    handles.append(Line2D([], [], color=QUIET_TEXT, linewidth=5, alpha=0.25, label="default"))
    if timed:
        handles.extend(
            Line2D([], [], color=TEXT, linestyle=dashes, label=f"time, {name}")
            for dashes, name in zip(_DASHES, ("views", "generated"), strict=True)
        )
    name_below(figure, handles)


def _row(part: SubFigure, count: int) -> Sequence[Axes]:
    return list(np.atleast_1d(part.subplots(1, count, sharey=True)))


def _rows(sweep: Sweep, data: str) -> pd.DataFrame:
    table = load_options()
    chosen = table[
        (table["method"] == sweep.method) & (table["option"] == sweep.option) & (table["data"] == data)
    ]
    return chosen.set_index("value").loc[[str(value) for value in sweep.levels]]


def _draw_scores(axes: Axes, sweep: Sweep, rows: pd.DataFrame, *, first: bool) -> None:
    places = np.arange(len(sweep.levels))
    for number, (column, (_, color, marker)) in enumerate(CURVES.items()):
        axes.plot(
            places if sweep.ordered else places + 0.12 * (number - 1),
            rows[column].to_numpy(dtype=float),
            color=color,
            marker=marker,
            linestyle="-" if sweep.ordered else "",
            linewidth=1.8 if column == "f_score" else 1.2,
            markersize=4,
            clip_on=False,
            zorder=4 if column == "f_score" else 3,
        )
    axes.set_ylim(0, 1)
    _name_values(axes, sweep)
    finish(axes, title=_title(sweep), ylabel="fraction" if first else "")


def _draw_times(axes: Axes, sweep: Sweep, *, first: bool) -> None:
    for data, dashes in zip(sweep.data, _DASHES, strict=True):
        times = _rows(sweep, data)["milliseconds"].to_numpy(dtype=float)
        axes.plot(range(len(times)), times, color=TEXT, linestyle=dashes, marker=".", linewidth=1.2, zorder=3)
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,g}"))
    axes.yaxis.set_minor_locator(NullLocator())
    _name_values(axes, sweep)
    finish(axes, ylabel="ms, one thread" if first else "", xlabel=_title(sweep))


def _title(sweep: Sweep) -> str:
    return f"{sweep.option} ({sweep.unit})" if sweep.unit else sweep.option


def _name_values(axes: Axes, sweep: Sweep) -> None:
    """Name the values on the x axis, evenly spaced, and mark the default."""
    axes.set_xticks(range(len(sweep.levels)), [_label(value) for value in sweep.levels])
    axes.set_xlim(-0.5, len(sweep.levels) - 0.5)
    if sweep.default in sweep.levels:
        axes.axvline(sweep.levels.index(sweep.default), color=QUIET_TEXT, linewidth=5, alpha=0.25, zorder=1)


def _label(value: object) -> str:
    if value is None:
        return "off"
    if isinstance(value, int | float) and not isinstance(value, bool) and value >= 10_000:
        exponent = len(str(int(value))) - 1
        return f"$10^{exponent}$"
    return str(value).replace("one_to_one", "one to\none").replace("local_score", "local\nscore")
