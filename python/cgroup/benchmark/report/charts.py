"""Charts of the report: as figures in files, and as numbers for plotly in the page."""

import math
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from cgroup.benchmark.report.cells import Table
from cgroup.evaluation.protocols import LEAST_PAIRS
from cgroup.io import write_file
from cgroup.io.result_folders import make_folder
from cgroup.pages.page import chart_html
from cgroup.plots.charts import Chart
from cgroup.plots.style import MethodStyle, method_styles

RESOLUTION = 150  # dots per inch of PNG files
_DIGITS = 5  # of numbers in the page


@dataclass(frozen=True)
class PageChart:
    """A chart on the page, of which one panel is shown at a time.

    `name` is that of its element, `alt` the text below it and for readers who can't see it. `files` are the
    names of figures of the same, without the ending.
    """

    name: str
    alt: str
    chart: Chart
    files: tuple[str, ...] = ()

    @property
    def has_intervals(self) -> bool:
        """Whether any value has an interval."""
        lows = (low for panel in self.chart.panels for series in panel.series for low in series.low)
        return any(map(math.isfinite, lows))

    def as_html(self) -> str:
        """Return the chart as HTML; `charts.js` draws it from its layout's `meta`."""
        meta = {
            "least": LEAST_PAIRS,
            "panels": [_shorten(asdict(panel)) for panel in self.chart.panels],
            "looks": {key: _name_look(look) for key, look in self.chart.looks.items()},
        }
        caption = escape(self.alt)
        if self.chart.is_sparse:
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


class Section(NamedTuple):
    """A part of the report: a chart if there is one, and tables. `label` describes the data."""

    title: str
    tables: list[Table]
    chart: PageChart | None = None
    anchor: str = ""
    label: str = ""


class FigureFiles:
    """Saves figures of charts in a folder.

    `begin` is called with the name of each figure. `methods` are all methods of the report; `styles` has the
    looks of each in all figures and charts.
    """

    def __init__(self, folder: Path, begin: Callable[[str], Any], methods: Iterable[str]) -> None:
        self.styles = method_styles(methods)
        self._folder = folder
        self._begin = begin
        make_folder(folder)

    def draw(self, name: str, alt: str, chart: Chart, title: str, *, columns: int = 3) -> PageChart:
        """Save a figure of a chart; return the chart for the page."""
        self.save(name, chart.draw(title, columns=columns))
        return PageChart(name, alt, chart, (name,))

    def save(self, name: str, figure: Figure) -> str:
        """Save a figure as PNG and PDF; return its name."""
        self._begin(f"figure {name}")
        write_file(self._folder / f"{name}.png", _render_figure(figure, "png"))
        figure.set_layout_engine("none")  # a second layout would take as long as drawing
        # A date would make every file of the same figure different.
        write_file(self._folder / f"{name}.pdf", _render_figure(figure, "pdf", {"CreationDate": None}))
        return name


def _render_figure(figure: Figure, kind: str, metadata: dict[str, Any] | None = None) -> bytes:
    buffer = BytesIO()
    figure.savefig(buffer, format=kind, dpi=RESOLUTION, metadata=metadata)
    return buffer.getvalue()


def _name_look(look: MethodStyle) -> dict[str, Any]:
    dash = "solid" if look.dashes == "-" else "dash"
    return {"label": look.label, "color": look.color, "symbol": look.symbol, "dash": dash, "size": look.size}


def _shorten(value: Any) -> Any:  # noqa: ANN401 - whatever JSON holds
    """Drop empty values and shorten numbers; None for NaN and infinity."""
    if isinstance(value, dict):
        short = {key: _shorten(each) for key, each in value.items()}
        return {key: each for key, each in short.items() if each not in ("", [], {})}
    if isinstance(value, (list, tuple)):
        return [_shorten(each) for each in value]
    if isinstance(value, (float, np.floating)):
        return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
    return value
