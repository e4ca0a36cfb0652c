"""Charts as data, and their print versions; the page of the report draws the same charts."""

# Parts of matplotlib's methods are untyped. pandas ships no types, and guesses about it are often wrong.
# pyright: reportUnknownMemberType=false

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator

from cgroup.evaluation.protocols import LEAST_PAIRS
from cgroup.plots import style
from cgroup.plots.style import MethodStyle
from cgroup.types import BoolArray, FloatArray

FEW = f"fewer than {LEAST_PAIRS} pairs"  # meaning of hollow markers
MARKER_SIZE = 4.5  # points across a disk
_PANEL_HEIGHT, _NAMES_HEIGHT = 2.3, 0.45  # inches, of a panel and of names below its x axis
_FONT = 8
_MOST_COLUMNS, _LETTERS, _HANDLE = 9, 110, 6.5  # of a legend: columns, letters that fit, those of a handle
_DOTS = (0, (1, 2.5))  # a line to levels of few pairs
_SPREAD = 0.32  # of the methods around a name
_SHORT_NAME = 4
_MANY = 300  # times the least place on a logarithmic axis: more than fits with 2 and 5 named
_NAMES_TURNED = 40  # degrees, for names on the x axis


@dataclass(frozen=True)
class Series:
    """The values of one method; lists that don't apply are empty, unknown values NaN."""

    key: str  # of its look
    y: Sequence[float]
    x: Sequence[float] = ()  # those of the panel by default
    low: Sequence[float] = ()  # of intervals
    high: Sequence[float] = ()
    counts: Sequence[int] = ()  # numbers of pairs that the values are means of
    notes: Sequence[str] = ()  # further lines to read at each point

    @property
    def sparse(self) -> BoolArray:
        """Whether each value is a mean of fewer pairs than `LEAST_PAIRS`."""
        counts = np.array(self.counts if len(self.counts) else [LEAST_PAIRS] * len(self.y))
        return (counts > 0) & (counts < LEAST_PAIRS)


@dataclass(frozen=True)
class Panel:
    """One view of a chart; all panels have the same keys, if these are methods."""

    title: str
    x_title: str
    y_title: str
    series: list[Series]
    at: Sequence[float | str] = ()  # levels of all series; names are neither ordered nor connected
    kind: Literal["curves", "points", "lines"] = "curves"  # lines with markers, markers, or steps
    share: bool = True  # whether values are from 0 to 1
    logarithmic: str = ""  # axes: "", "x" or "xy"
    bounds: Mapping[str, float] = field(default_factory=dict[str, float])  # of a registered pair, by axis

    @property
    def names(self) -> list[str]:
        """The levels if they are names, else none."""
        return [level for level in self.at if isinstance(level, str)]


@dataclass(frozen=True)
class Chart:
    """Panels, and the styles of their series in the order of the legend."""

    panels: list[Panel]
    looks: Mapping[str, MethodStyle]

    @property
    def is_sparse(self) -> bool:
        """Whether some values are means of fewer pairs than `LEAST_PAIRS`."""
        return any(series.sparse.any() for panel in self.panels for series in panel.series)

    def draw(self, title: str, *, columns: int = 3, legend: Literal["below", "right"] = "below") -> Figure:
        """Draw all panels in a number of columns, at print width."""
        extra = _NAMES_HEIGHT if any(panel.names for panel in self.panels) else 0.2
        figure, axes = panels(len(self.panels), columns=columns, title=title, extra=extra)
        for each, panel in zip(axes, self.panels, strict=True):
            _draw_panel(each, panel, self.looks)
        _name_methods(figure, self.looks, legend, few=self.is_sparse)
        return figure


def panels(count: int, *, columns: int, title: str, extra: float = 0.0) -> tuple[Figure, list[Axes]]:
    """Make a figure of print width with panels side by side; labels take `extra` inches of height."""
    rows = -(-count // columns)
    size = (style.PRINT_WIDTH, rows * (_PANEL_HEIGHT + extra) + 0.75)
    layout = ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.05)
    figure = Figure(figsize=size, dpi=style.DOTS_PER_INCH, layout=layout)
    grid = figure.subplots(rows, min(columns, count), squeeze=False).reshape(-1)
    for axes in grid[count:]:
        axes.set_axis_off()
    figure.suptitle(title, color=style.TEXT, fontsize=_FONT + 1.5)
    return figure, list(grid[:count])


def finish(axes: Axes, *, title: str = "", xlabel: str = "", ylabel: str = "", share: bool = False) -> None:
    """Label a panel; the y axis of a fraction is from 0 to 1."""
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


def sort_methods(methods: Iterable[str]) -> list[str]:
    """Sort methods: the paper's order, then any others."""
    known = list(style.METHOD_STYLES)
    return sorted(methods, key=lambda name: known.index(name) if name in known else len(known))


def marker_size(look: MethodStyle) -> float:
    """Size of a marker in points."""
    return MARKER_SIZE * look.size


def _draw_panel(axes: Axes, panel: Panel, looks: Mapping[str, MethodStyle]) -> None:
    xlabel = style.as_it_is(panel.x_title)
    finish(axes, title=panel.title, xlabel=xlabel, ylabel=panel.y_title, share=panel.share)
    aside = np.linspace(-_SPREAD, _SPREAD, len(panel.series)) if panel.names else [0.0] * len(panel.series)
    for series, shift in zip(panel.series, aside, strict=True):
        at = range(len(panel.names)) if panel.names else series.x or panel.at
        places = np.array(at, dtype=np.float64)
        look, heights = looks[series.key], np.array(series.y, dtype=np.float64)
        if panel.kind == "lines":
            axes.step(places, heights, where="post", color=look.color, linestyle=look.dashes, linewidth=1.4)
            continue
        if panel.kind == "curves" and not panel.names:
            _connect(axes, places, heights, look, series.sparse)
        _mark(axes, places + shift, heights, look, series.sparse)
    _place_levels(axes, panel)
    for axis, place in panel.bounds.items():
        draw_line = axes.axvline if axis == "x" else axes.axhline
        draw_line(place, color=style.QUIET_TEXT, linewidth=0.8, linestyle=":")
        at = (place, "data"), (0.93, "axes fraction")
        (x, across), (y, up) = at if axis == "x" else at[::-1]
        axes.annotate(
            "registered", (x, y), xycoords=(across, up), xytext=(3, 2), textcoords="offset points",
            fontsize=7, color=style.QUIET_TEXT, horizontalalignment="left" if axis == "x" else "right",
        )  # fmt: skip
    if panel.kind == "lines" and not panel.logarithmic:
        axes.set_xlim(0, 1)


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


def _mark(axes: Axes, places: FloatArray, heights: FloatArray, look: MethodStyle, sparse: BoolArray) -> None:
    for hollow in (False, True):
        if (sparse == hollow).any():
            axes.plot(
                places, heights, marker=look.marker, markevery=np.flatnonzero(sparse == hollow).tolist(),
                color=look.color, linestyle="", markersize=marker_size(look),
                markerfacecolor="white" if hollow else look.color,
                markeredgecolor=look.color if hollow else "white",
                markeredgewidth=0.9 if hollow else 0.4, clip_on=False, zorder=3,
            )  # fmt: skip


def _place_levels(axes: Axes, panel: Panel) -> None:
    if panel.names:
        axes.set_xticks(range(len(panel.names)), panel.names)
        axes.set_xlim(-0.6, len(panel.names) - 0.4)
        if max(map(len, panel.names)) > _SHORT_NAME:
            for label in axes.get_xticklabels():
                label.set(rotation=_NAMES_TURNED, horizontalalignment="right", rotation_mode="anchor")
    if "x" in panel.logarithmic:
        axes.set_xscale("log")
        axes.margins(x=0.15)
        if panel.at:
            axes.set_xticks([float(level) for level in panel.at], [f"{level:,}" for level in panel.at])
            axes.tick_params(axis="x", rotation=30)
        else:
            low, high = axes.get_xlim()
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < _MANY * low else (1.0,)))
            axes.xaxis.set_major_formatter(lambda tick, _: f"{tick:g}")
        axes.minorticks_off()
    if "y" in panel.logarithmic:
        axes.set_yscale("log")
    elif not panel.share:
        axes.set_ylim(0, None)


def _name_methods(
    figure: Figure, looks: Mapping[str, MethodStyle], place: Literal["below", "right"], *, few: bool
) -> None:
    """Draw the legend of methods, and of hollow markers for levels with few pairs."""
    handles = [
        Line2D(
            [], [], color=look.color, marker=look.marker, linestyle=look.dashes, linewidth=1.1,
            markersize=marker_size(look), label=look.label,
        )
        for look in (look._replace(label=style.as_it_is(look.label)) for look in looks.values())
    ]  # fmt: skip
    if few:
        hollow = Line2D([], [], color=style.QUIET_TEXT, marker="o", markerfacecolor="white", label=FEW)
        hollow.set(linestyle=_DOTS, linewidth=0.7, markersize=MARKER_SIZE)
        handles.append(hollow)
    lengths = [len(str(handle.get_label())) for handle in handles]
    is_below = place == "below"
    figure.legend(
        handles=handles, loc="outside lower center" if is_below else "outside right upper", frameon=False,
        ncols=_count_columns(lengths) if is_below else 1, fontsize=_FONT, handlelength=2.4,
        columnspacing=1.1, handletextpad=0.4,
    )  # fmt: skip


def _count_columns(lengths: list[int]) -> int:
    """Return the number of columns of names that fit, filled in turn by names of these lengths."""
    for count in range(min(len(lengths), _MOST_COLUMNS), 1, -1):
        width = sum(max(column) for column in np.array_split(lengths, count)) + count * _HANDLE
        if width <= _LETTERS:
            return count
    return 1
