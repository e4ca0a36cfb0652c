"""Interactive charts of the page, as numbers for plotly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup.benchmark.stats import bootstrap, name_units
from cgroup.evaluation.bins import LEAST_PAIRS
from cgroup.pages.page import chart_html
from cgroup.plots.charts import Chart
from cgroup.plots.experiments import Estimate
from cgroup.plots.style import MethodStyle

if TYPE_CHECKING:  # slow to load
    import pandas as pd

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
    def titles(self) -> list[str]:
        """Titles of the panels, for the buttons that show them."""
        return [panel.title for panel in self.chart.panels]

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


def estimate_with_intervals(rows: pd.DataFrame, columns: Sequence[str]) -> dict[str, dict[str, Estimate]]:
    """Return means over pairs with their intervals; without intervals for too few pairs."""
    pairs = rows[["dataset", "pair"]].drop_duplicates()
    units = dict(zip(zip(pairs["dataset"], pairs["pair"], strict=True), name_units(pairs), strict=True))
    keys = [units[key] for key in zip(rows["dataset"], rows["pair"], strict=True)]
    values = rows[list(columns)].astype(float).assign(unit=keys, method=rows["method"].to_numpy())
    grouped = values.groupby(["unit", "method"], sort=False)
    sums, counts = (table.unstack("method").fillna(0.0) for table in (grouped.sum(), grouped.count()))  # noqa: PD010 - of a sum
    numbers = rows.groupby("method")["pair"].nunique()
    intervals = bootstrap(sums.to_numpy(np.float64), counts.to_numpy(np.float64))
    found: dict[str, dict[str, Estimate]] = {column: {} for column in columns}
    for (column, method), (mean, low, high) in zip(sums.columns, intervals, strict=True):
        several = numbers[method] >= LEAST_PAIRS and len(sums) >= LEAST_PAIRS
        ends = (low, high) if several else (math.nan, math.nan)
        found[column][method] = Estimate(mean, *ends, int(numbers[method]))
    return found


def _name_look(look: MethodStyle) -> dict[str, Any]:
    """Return a look by the names of plotly."""
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
