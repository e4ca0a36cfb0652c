"""Interactive charts of the page: what they show as plain numbers, which `charts.js` draws with plotly."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from html import escape
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from cgroup.evaluation.bins import LEAST_PAIRS
from cgroup.pages import chart_html
from cgroup.plots.curves import sort_methods
from cgroup.plots.style import method_styles

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from matplotlib.typing import LineStyleType

    from cgroup.plots.style import MethodStyle

_DIGITS = 5  # that numbers are written with


class Look(NamedTuple):
    """How one method is drawn: label, colour, plotly's names of marker and dashes, size beside a disk's."""

    label: str
    color: str
    symbol: str = "circle"
    dash: str = "solid"
    size: float = 1.0


@dataclass(frozen=True)
class Series:
    """What is drawn of one method.

    Attributes
    ----------
    key : str
        Of its look.
    y : sequence of float
        Values; NaN where there are none.
    x : sequence of float
        Their places; those of the panel if there are none.
    low, high : sequence of float
        Intervals; none, or NaN where there is none.
    counts : sequence of int
        How many pairs each value is a mean of; none where that isn't what it is.
    notes : sequence of str
        Further lines to read at each point.
    """

    key: str
    y: Sequence[float]
    x: Sequence[float] = ()
    low: Sequence[float] = ()
    high: Sequence[float] = ()
    counts: Sequence[int] = ()
    notes: Sequence[str] = ()


@dataclass(frozen=True)
class Panel:
    """One view of a chart.

    Attributes
    ----------
    title, x_title, y_title : str
        Of the button that shows it, and of the axes.
    series : list of Series
        All panels of a chart have the same keys, where they are methods.
    at : sequence of float or str
        Levels, which serve all series; names have no order, and nothing connects them.
    kind : {"curves", "points", "lines"}
        Lines with markers, markers with their labels, or lines alone, which are steps.
    share : bool
        Whether values go from 0 to 1.
    logarithmic : str
        Axes that are: "", "x" or "xy".
    """

    title: str
    x_title: str
    y_title: str
    series: list[Series]
    at: Sequence[float | str] = ()
    kind: Literal["curves", "points", "lines"] = "curves"
    share: bool = True
    logarithmic: str = ""


@dataclass(frozen=True)
class Chart:
    """A chart with one or several panels, of which one is shown at a time.

    Attributes
    ----------
    name : str
        Of its element.
    alt : str
        What it shows, for those who don't see it, and below it for all.
    panels : list of Panel
        The first is shown first.
    looks : dict of str to Look
        Of all keys.
    files : tuple of str
        Names of figures of the same, without the ending.
    """

    name: str
    alt: str
    panels: list[Panel]
    looks: Mapping[str, Look]
    files: tuple[str, ...] = ()

    @property
    def sparse(self) -> bool:
        """Whether some values are means of fewer pairs than tell anything."""
        return any(
            0 < count < LEAST_PAIRS
            for panel in self.panels
            for series in panel.series
            for count in series.counts
        )

    @property
    def has_intervals(self) -> bool:
        """Whether some values have an interval."""
        return any(
            math.isfinite(low) for panel in self.panels for series in panel.series for low in series.low
        )

    def as_html(self) -> str:
        """Write the chart for the page; `charts.js` fills it from what lies in its layout's `meta`."""
        meta = {
            "least": LEAST_PAIRS,
            "panels": [_shorten(asdict(panel)) for panel in self.panels],
            "looks": {key: look._asdict() for key, look in self.looks.items()},
        }
        caption = escape(self.alt)
        if self.sparse:
            caption += (
                f" <strong>Hollow markers, dotted lines: fewer than {LEAST_PAIRS} pairs, too few for a curve"
                " or an interval.</strong>"
            )
        if self.files:
            links = ", ".join(
                f'<a href="figures/{escape(name)}.png">{escape(name)}.png</a> '
                f'(<a href="figures/{escape(name)}.pdf" aria-label="{escape(name)}.pdf">pdf</a>)'
                for name in self.files
            )
            caption += f' <span class="files">For print: {links}</span>'
        return chart_html(
            f"chart-{self.name}", {"data": [], "layout": {"meta": meta}}, label=self.alt, caption=caption
        )


def look_up(methods: Iterable[str], styles: Mapping[str, MethodStyle]) -> dict[str, Look]:
    """Choose the looks of methods, those of the figures, in the order of their legends."""
    chosen = method_styles(methods, styles)
    return {
        name: Look(style.label, style.color, style.symbol, dash_of(style.dashes), style.size)
        for name, style in ((name, chosen[name]) for name in sort_methods(chosen))
    }


def dash_of(dashes: LineStyleType) -> str:
    """Return plotly's name of matplotlib's dashes."""
    return "solid" if dashes == "-" else "dash"


def _shorten(value: Any) -> Any:  # noqa: ANN401 - whatever JSON holds
    """Leave out what is empty, and write numbers with few digits, None where there is none."""
    if isinstance(value, dict):
        short = {key: _shorten(each) for key, each in value.items()}
        return {key: each for key, each in short.items() if each not in ("", [])}
    if isinstance(value, (list, tuple)):
        return [_shorten(each) for each in value]
    if isinstance(value, float):
        return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
    return value
