"""Figures of a method's F on harder and harder problems, and of its cost, with other methods."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D

from cgroup.plots.style import TEXT, method_style
from cgroup.registry import find_method
from method_figures.drawing import FONT, finish, name_below, new_figure
from method_figures.measured import load_methods
from method_figures.sweeps import beside

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NEEDS_FRAMES = ("si", "cv", "hough3d")
_KINDS = {
    "uniform": "random",
    "second-pose": "second\npose",
    "planes": "planes",
    "mirror": "mirror\nimage",
    "one-to-three": "one to\nthree",
}
_ASIDE = 0.17  # of the methods around a name
_SHARES = (0.5, 0.2, 0.1, 0.05, 0.02, 0.01)


def draw_limits(method: str) -> Figure:
    """Draw F over the fraction of correct matches, over noise, and over kinds of wrong matches or frames."""
    figure = new_figure(3.0)
    first, second, third = figure.subplots(1, 3, sharey=True)
    table = load_methods()
    shown = (method, *beside(method))
    for place, name in reversed(list(enumerate(shown))):
        strong = name == method
        rows = _of(table, name)
        sized = rows[rows["set"] == "1000"].set_index("inliers")["f_score"]
        _curve(first, name, sized.reindex(_SHARES), strong=strong)
        noisy = (
            rows[(rows["set"] == "noise") & (rows["inliers"] == 0.1)]
            .set_index("noise")["f_score"]
            .sort_index()
        )
        _curve(second, name, noisy, strong=strong)
        named = _by_frames(rows) if method in NEEDS_FRAMES else _by_kind(rows)
        _curve(
            third,
            name,
            named.set_axis(np.arange(len(named)) + _ASIDE * (place - 1.5)),
            strong=strong,
            joined=False,
        )
    first.set_xscale("log")
    first.invert_xaxis()
    first.set_xticks(_SHARES, [f"{100 * share:g}" for share in _SHARES])
    first.minorticks_off()
    first.set_ylim(0, 1)
    finish(first, title="Fewer correct of 1,000", xlabel="correct matches (%)", ylabel="F")
    finish(second, title="More noise (10 % correct)", xlabel="noise per axis (pr)")
    if method in NEEDS_FRAMES:
        third.set_xticks(range(3), ["good", "bad", "none"])
        finish(third, title="Worse frames (10 % correct)", xlabel="frames")
    else:
        third.set_xticks(range(len(_KINDS)), list(_KINDS.values()))
        finish(third, title="Wrong matches (2 % correct)")
    third.tick_params(axis="x", labelsize=FONT - 2)
    third.set_xlim(-0.5, third.get_xticks()[-1] + 0.5)
    third.grid(visible=False, axis="x")
    name_methods(figure, method)
    return figure


def _of(table: pd.DataFrame, name: str) -> pd.DataFrame:
    return table[table["method"] == find_method(name).name]


def _by_kind(rows: pd.DataFrame) -> pd.Series:
    chosen = rows[(rows["set"] == "kinds") & (rows["inliers"] == 0.02)].set_index("scene")["f_score"]
    return chosen.reindex(list(_KINDS))


def _by_frames(rows: pd.DataFrame) -> pd.Series:
    chosen = rows[(rows["set"] == "frames") & (rows["inliers"] == 0.1)].set_index("frames")["f_score"]
    return chosen.reindex(["good", "bad", "none"]).fillna(0.0)


def _curve(axes: Axes, name: str, values: pd.Series, *, strong: bool, joined: bool = True) -> None:
    look = method_style(find_method(name).name)
    axes.plot(
        list(values.index),
        values.to_numpy(dtype=float),
        color=look.color,
        marker=look.marker,
        linestyle=look.dashes if joined else "",
        linewidth=2.4 if strong else 1.1,
        markersize=7 if strong else 4.5,
        alpha=1.0 if strong else 0.75,
        markeredgecolor="white",
        markeredgewidth=0.5,
        clip_on=False,
        zorder=4 if strong else 3,
    )


def name_methods(figure: Figure, method: str) -> None:
    """Name the method and those beside it, in its order."""
    handles = []
    for name in (method, *beside(method)):
        look = method_style(find_method(name).name)
        strong = name == method
        handles.append(
            Line2D(
                [],
                [],
                color=look.color,
                marker=look.marker,
                linestyle=look.dashes,
                linewidth=2.4 if strong else 1.1,
                markersize=7 if strong else 4.5,
                label=look.label,
            )
        )
    name_below(figure, handles)


def draw_cost(method: str) -> Figure:
    """Draw time and peak memory over the number of matches, all other methods in the background."""
    figure = new_figure(2.9)
    panels = figure.subplots(1, 2)
    table = load_methods()
    chosen = table[table["set"].isin(["200", "1000", "5000", "20000"]) & (table["inliers"] == 0.1)]
    for axes, column in zip(panels, ("milliseconds", "mebibytes"), strict=True):
        shown = (method, *beside(method))
        for name, rows in chosen.groupby("method"):
            if name not in [find_method(each).name for each in shown]:
                values = rows.set_index("n")[column].sort_index()
                axes.plot(
                    values.index, np.maximum(values, _LEAST[column]), color="#d9d9d9", linewidth=0.9, zorder=1
                )
        for name in reversed(shown):
            values = _of(chosen, name).set_index("n")[column].sort_index()
            _curve(axes, name, values.clip(lower=_LEAST[column]), strong=name == method)
        axes.set(xscale="log", yscale="log")
        axes.set_xticks([200, 1000, 5000, 20000], ["200", "1,000", "5,000", "20,000"])
        axes.minorticks_off()
    finish(panels[0], title="Time, one thread, 10 % correct", xlabel="matches", ylabel="ms")
    finish(panels[1], title="Peak memory without the matches", xlabel="matches", ylabel="MiB")
    panels[1].text(
        0.02,
        0.97,
        "grey: all other methods",
        transform=panels[1].transAxes,
        va="top",
        fontsize=7.5,
        color=TEXT,
    )
    name_methods(figure, method)
    return figure


_LEAST = {"milliseconds": 0.001, "mebibytes": 0.05}
