"""Pipelines that register whole clouds: share of right poses by overlap, and beside the time they take."""

# Parts of matplotlib's methods are untyped. pandas ships no types, and guesses about it are often wrong.
# pyright: reportUnknownMemberType=false, reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from matplotlib.lines import Line2D

from cgroup.plots import style
from cgroup.plots.curves import finish, panels

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.path import Path
    from matplotlib.typing import LineStyleType

OVERLAP_EDGES = (0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0)
"""Pairs are sorted into these classes of overlap."""

_LEAST = 3  # pairs in a class of overlap that is drawn
_SECONDS = (0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100)
_BLUES = ("#0B3C8C", "#1F77B4", "#6BAED6", "#9ECAE1")
_GREENS = ("#00682F", "#2CA25F", "#66C2A4", "#99D8C9")
_REDS = ("#B2182B", "#E6550D", "#FDAE6B")
_PURPLES = ("#6A1B9A", "#BA68C8")
_FAMILIES = {
    "cgroup": _BLUES,
    "cgroup-paper": _BLUES,
    "cgroup-matches": _GREENS,
    "open3d-ransac": _REDS,
    "open3d-fgr": _REDS,
    "kiss-matcher": _PURPLES,
}
"""Shades of each kind of pipeline; others are drawn as methods from outside are."""

_MARKERS = "osD^v<>PXhpd"


class Look(NamedTuple):
    """How one pipeline is drawn, as `style.MethodStyle` says of methods."""

    color: str
    marker: str | Path
    symbol: str
    dashes: LineStyleType


def pipelines_figure(frame: pd.DataFrame, *, title: str) -> Figure:
    """Draw how many pairs pipelines register, by overlap and over time.

    Parameters
    ----------
    frame : DataFrame
        `pipeline, name, refined, set, overlap, right, seconds`, one row per pair and pipeline; without
        unrelated clouds.
    title : str
        Shown on top.

    Returns
    -------
    Figure
        A panel with the share of right poses over the overlap, all sets together, and for each set one with
        that share over the median seconds.

    Raises
    ------
    KeyError
        For rows that lack a column.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.plots import pipelines_figure
    >>> frame = pd.DataFrame(
    ...     {"pipeline": "cgroup", "name": "cgroup", "set": "rooms"}, index=[0, 1]
    ... )
    >>> frame = frame.assign(
    ...     refined=False, overlap=[0.3, 0.8], right=[False, True], seconds=[0.5, 0.4]
    ... )
    >>> len(pipelines_figure(frame, title="One way to register").axes)
    2
    """
    sets = list(dict.fromkeys(frame["set"]))
    looks = choose_looks(frame)
    figure, axes = panels(1 + len(sets), columns=3, title=title, extra=0.2)
    _draw_overlap(axes[0], frame, looks)
    for each, name in zip(axes[1:], sets, strict=True):
        finish(each, title=name, xlabel="median seconds per pair", share=True)
        _draw_times(each, frame[frame["set"] == name], looks)
    axes[0].set_ylabel("share of right poses", fontsize=8, color=style.TEXT)
    _name_pipelines(figure, looks)
    return figure


def choose_looks(frame: pd.DataFrame) -> dict[str, Look]:
    """Choose colours by the kind of pipeline, and markers by the order; refined ones are drawn dashed."""
    named = frame.drop_duplicates("pipeline")
    own = style.own_styles(named.loc[~named["name"].isin(_FAMILIES), "pipeline"])
    looks: dict[str, Look] = {}
    used: dict[tuple[str, ...], int] = {}
    for label, name, refined in zip(named["pipeline"], named["name"], named["refined"], strict=True):
        dashes = (0, (3, 1.5)) if refined else "-"
        if label in own:
            looks[label] = Look(own[label].color, own[label].marker, own[label].symbol, dashes)
            continue
        shades = _FAMILIES[name]
        used[shades] = used.get(shades, -1) + 1
        color, marker = shades[used[shades] % len(shades)], _MARKERS[len(looks) % len(_MARKERS)]
        looks[label] = Look(color, marker, style.SYMBOLS[marker], dashes)
    return looks


def _draw_overlap(axes: Axes, frame: pd.DataFrame, looks: dict[str, Look]) -> None:
    classes = np.digitize(frame["overlap"].to_numpy(), OVERLAP_EDGES[1:-1])
    right, labels = frame["right"].to_numpy(), frame["pipeline"].to_numpy()
    known = np.isfinite(frame["overlap"].to_numpy())
    for name, look in looks.items():
        places: list[float] = []
        shares: list[float] = []
        for number, (lowest, highest) in enumerate(itertools.pairwise(OVERLAP_EDGES)):
            chosen = right[known & (labels == name) & (classes == number)]
            if len(chosen) >= _LEAST:
                places.append((lowest + highest) / 2)
                shares.append(float(chosen.mean()))
        axes.plot(places, shares, color=look.color, **_line(look))
    finish(axes, title="by overlap, all sets", xlabel="overlap (share)", share=True)
    axes.set_xlim(0, 1)


def _draw_times(axes: Axes, frame: pd.DataFrame, looks: dict[str, Look]) -> None:
    for name, look in looks.items():
        chosen = frame[frame["pipeline"] == name]
        if len(chosen):
            place = [chosen["seconds"].median()], [chosen["right"].mean()]
            axes.plot(*place, color=look.color, **_line(look) | {"linestyle": ""})
    axes.set_xscale("log")
    axes.margins(x=0.15)
    lowest, highest = axes.get_xlim()
    ticks = [tick for tick in _SECONDS if lowest <= tick <= highest]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.minorticks_off()


def _line(look: Look) -> dict[str, object]:
    return {
        "marker": look.marker,
        "linestyle": look.dashes,
        "linewidth": 1.0,
        "markersize": 5,
        "markeredgecolor": "white",
        "markeredgewidth": 0.4,
        "clip_on": False,
        "zorder": 3,
    }


def _name_pipelines(figure: Figure, looks: dict[str, Look]) -> None:
    handles = [
        Line2D([], [], color=look.color, label=style.as_it_is(name), **_line(look))
        for name, look in looks.items()
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
