"""Charts of benchmark results: scores and registration over levels, times, single pairs.

Values are means over pairs with their intervals.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cgroup.benchmark.stats import bootstrap, name_units
from cgroup.evaluation import ecdf
from cgroup.evaluation.protocols import LEAST_PAIRS, PAPER_PROTOCOL, PROTOCOL_PREFIX, PROTOCOLS
from cgroup.plots import style
from cgroup.plots.charts import Chart, Panel, Series, sort_methods
from cgroup.plots.style import MethodStyle

OVERLAP_EDGES = (0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0)  # pairs are sorted into these classes of overlap
PROBABILITY_EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)  # poses are sorted into these classes of probability
_SCORES = {"f_score": "F", "precision": "precision", "recall": "recall"}
_MATCHES = {
    "all": MethodStyle("all", style.QUIET_TEXT, "s", "square"),
    "correct": MethodStyle("correct", style.CORRECT, "o", "circle"),
}
_SHADES = {
    ("cgroup", "cgroup-paper", "register-all"): ("#0B3C8C", "#1F77B4", "#6BAED6", "#9ECAE1"),
    ("cgroup-matches",): ("#00682F", "#2CA25F", "#66C2A4", "#99D8C9"),
    ("open3d-ransac", "open3d-fgr", "open3d-multiway"): ("#B2182B", "#E6550D", "#FDAE6B"),
    ("kiss-matcher", "kiss-matcher-gnc"): ("#6A1B9A", "#BA68C8"),
}
"""Shades of each kind of pipeline; others are drawn as methods from outside are."""

_FAMILIES = {name: shades for names, shades in _SHADES.items() for name in names}
_MARKERS = "osD^v<>PXhpd"
_STEPS = 100  # of a distribution


class Estimate(NamedTuple):
    """Mean over pairs, the ends of its interval (NaN without one), and the number of pairs."""

    mean: float
    low: float
    high: float
    pairs: int


_NOTHING = Estimate(np.nan, np.nan, np.nan, 0)

Estimates: TypeAlias = Mapping[str, Mapping[str, Estimate]]  # by column and method


def estimate(rows: pd.DataFrame, columns: Sequence[str]) -> Estimates:
    """Return means over pairs with their intervals; without intervals for too few pairs."""
    values = rows[list(columns)].astype(float).assign(unit=name_units(rows), method=rows["method"].to_numpy())
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


# --- Over the levels of an experiment ---------------------------------------------------------------------


def scores_chart(rows: pd.DataFrame, xlabel: str, styles: Mapping[str, MethodStyle]) -> Chart:
    """Chart mean precision, recall and F over the levels in the column ``x``."""
    titles = {column: (title, f"mean {title}") for column, title in _SCORES.items()}
    return _over_levels(rows, titles, xlabel, styles)


def rates_chart(rows: pd.DataFrame, xlabel: str, styles: Mapping[str, MethodStyle]) -> Chart:
    """Chart the fraction of registered pairs, by each criterion that applies to some record."""
    strict = [name for name in rows.columns if name.startswith(PROTOCOL_PREFIX) and rows[name].notna().any()]
    titles = {"registered": PAPER_PROTOCOL} | {name: name.removeprefix(PROTOCOL_PREFIX) for name in strict}
    named = {column: (protocol_title(name), "share of pairs registered") for column, name in titles.items()}
    return _over_levels(rows, named, xlabel, styles)


def matches_chart(rows: pd.DataFrame, xlabel: str) -> Chart:
    """Chart the initial matches, which do not depend on the method."""
    once = rows.drop_duplicates(["dataset", "pair", "x"]).assign(method="all")
    levels, found = _estimate_levels(once, ("n", "correct", "inlier_ratio"))
    numbers = [_series(key, "all", column, found) for key, column in (("all", "n"), ("correct", "correct"))]
    ratio = [_series("correct", "all", "inlier_ratio", found)]
    return Chart(
        [
            Panel("initial matches", xlabel, "mean number", numbers, at=levels, share=False),
            Panel("inlier ratio", xlabel, "share correct", ratio, at=levels, share=False),
        ],
        _MATCHES,
    )


def _over_levels(
    rows: pd.DataFrame,
    titles: Mapping[str, tuple[str, str]],
    xlabel: str,
    styles: Mapping[str, MethodStyle],
) -> Chart:
    """Chart columns of the records, a panel each, titled as given beside its y axis."""
    looks = choose_looks(rows["method"], styles)
    levels, found = _estimate_levels(rows, tuple(titles))
    return Chart(
        [
            Panel(title, xlabel, y_title, [_series(m, m, column, found) for m in looks], at=levels)
            for column, (title, y_title) in titles.items()
        ],
        looks,
    )


def _estimate_levels(rows: pd.DataFrame, columns: Sequence[str]) -> tuple[list[float | str], list[Estimates]]:
    levels = sorted(rows["x"].dropna().unique().tolist())
    return levels, [estimate(rows[rows["x"] == level], columns) for level in levels]


def _series(
    key: str,
    method: str,
    column: str,
    found: Iterable[Estimates],
    x: Sequence[float] = (),
) -> Series:
    mean, low, high, pairs = zip(*(each.get(column, {}).get(method, _NOTHING) for each in found), strict=True)
    return Series(key, y=mean, x=x, low=low, high=high, counts=pairs)


def protocol_title(protocol: str) -> str:
    """Return a readable name of a registration criterion."""
    known = PROTOCOLS.get(protocol)
    return protocol if known is None else known.title


def choose_looks(methods: Iterable[str], styles: Mapping[str, MethodStyle]) -> dict[str, MethodStyle]:
    """Choose the styles of methods, in the order of the legend."""
    chosen = style.method_styles(methods, styles)
    return {name: chosen[name] for name in sort_methods(chosen)}


# --- Times, pairs one by one, and how often over how fast -------------------------------------------------


def times_chart(
    times: pd.DataFrame,
    exponents: Mapping[str, float],
    complexities: Mapping[str, str],
    styles: Mapping[str, MethodStyle],
) -> Chart:
    """Chart milliseconds over the number of matches, with each method's growth in notes."""
    looks = choose_looks(times.columns, styles)
    series = [
        Series(
            method,
            y=(1e3 * times[method]).tolist(),
            notes=[describe_growth(exponents.get(method, np.nan), complexities.get(method))] * len(times),
        )
        for method in looks
    ]
    panel = Panel(
        "time", "number of matches n", "milliseconds per grouping, one thread", series,
        at=times.index.tolist(), share=False, logarithmic="xy",
    )  # fmt: skip
    return Chart([panel], looks)


def describe_growth(exponent: float, paper: str | None) -> str:
    """Describe the growth of a method's time, as measured and by the paper's table."""
    measured = "" if np.isnan(exponent) else f"measured n^{exponent:.2f}"
    return "; ".join(filter(None, (measured, paper and f"paper {paper}")))


def draw_times(
    times: pd.DataFrame,
    exponents: Mapping[str, float],
    complexities: Mapping[str, str],
    styles: Mapping[str, MethodStyle],
    title: str,
) -> Figure:
    """Draw `times_chart` with exponents and complexities in the legend, slowest method first."""
    chart = times_chart(times, exponents, complexities, styles)
    last = times.ffill().iloc[-1]
    looks: dict[str, MethodStyle] = {}
    for name in sorted(chart.looks, key=lambda name: -last[name]):
        growth = describe_growth(exponents.get(name, np.nan), complexities.get(name))
        looks[name] = chart.looks[name]._replace(label=f"{chart.looks[name].label}  {growth}".rstrip())
    return replace(chart, looks=looks).draw(title, columns=1, legend="right")


def trials_chart(related: pd.DataFrame, styles: Mapping[str, MethodStyle]) -> Chart:
    """Chart the fraction of registered problems, and mean F, over median time."""
    looks = choose_looks(related["method"], styles)
    milliseconds = 1e3 * related.groupby("method")["seconds"].median()
    found = [estimate(related, ("right", "f_score"))]
    panels = [
        Panel(
            title, "median milliseconds per call", f"{title} (mean over problems)",
            [_series(m, m, column, found, x=[float(milliseconds[m])]) for m in looks],
            kind="points", logarithmic="x",
        )
        for column, title in (("right", "registered"), ("f_score", "F"))
    ]  # fmt: skip
    return Chart(panels, looks)


def scenes_chart(good: pd.DataFrame) -> Chart:
    """Chart the fraction of scan pairs up to each error, set by set: rotation and translation."""
    looks = _style_pipelines(good)
    columns = {"rotation": "degrees", "translation": "shift, in the data's unit"}
    panels = [
        Panel(
            f"{name}: {column}", x_title, "share of pairs up to it",
            _distributions(of_set.groupby("method", sort=False)[column].sum().to_dict()),
            kind="lines", logarithmic="x",
        )
        for name, of_set in good.groupby("set", sort=False)
        for column, x_title in columns.items()
    ]  # fmt: skip
    return Chart(panels, looks)


def _distributions(errors: Mapping[str, tuple[float, ...]]) -> list[Series]:
    """Return the cumulative distributions of all solvers' errors at common values."""
    every = np.array([error for each in errors.values() for error in each])
    known = every[np.isfinite(every) & (every > 0)]
    at = np.geomspace(known.min(), known.max(), _STEPS) if len(known) else np.empty(0)
    return [Series(key, y=ecdf(each, at).tolist(), x=at.tolist()) for key, each in errors.items()]


def pipelines_chart(frame: pd.DataFrame) -> Chart:
    """Chart the registered pairs of pipelines by overlap and time, and the calibration of probabilities."""
    rows = frame[frame["kind"] == "related"]
    looks = _style_pipelines(rows)
    panels: list[Panel] = []
    if rows["overlap"].notna().any():
        series, at = _share_right(rows, "overlap", OVERLAP_EDGES, looks)
        panels.append(Panel("by overlap", "overlap (share), all sets", "share of right poses", series, at=at))
    stated = frame[frame["probability"].notna()]
    if len(stated):
        named = [name for name in looks if (stated["method"] == name).any()]
        series, at = _share_right(stated, "probability", PROBABILITY_EDGES, named)
        panels.append(Panel("reliability", "probability, all pairs", "share of right poses", series, at=at))
    for name, of_set in rows.groupby("set", sort=False):
        found = estimate(of_set, ("right",))
        seconds = of_set.groupby("method")["seconds"].median()
        points = [
            _series(m, m, "right", [found], x=[float(seconds[m])]) for m in looks if m in found["right"]
        ]
        panels.append(
            Panel(
                str(name), "median seconds per pair", "share of right poses", points,
                kind="points", logarithmic="x",
            )
        )  # fmt: skip
    return Chart(panels, looks)


def _share_right(
    rows: pd.DataFrame, column: str, edges: Sequence[float], looks: Iterable[str]
) -> tuple[list[Series], list[float]]:
    """Return the fraction of correct poses in bins of a number, and the centres of the bins."""
    places = np.digitize(rows[column].to_numpy(), edges[1:-1])
    known = rows[column].notna().to_numpy()
    chosen = [rows[known & (places == number)] for number in range(len(edges) - 1)]
    found = [estimate(each, ("right",)) if len(each) else {} for each in chosen]
    middles = [(low + high) / 2 for low, high in itertools.pairwise(edges)]
    return [_series(name, name, "right", found) for name in looks], middles


def _style_pipelines(frame: pd.DataFrame) -> dict[str, MethodStyle]:
    """Choose colours by the kind of pipeline, markers by the order, and dashes for refined pipelines."""
    named = frame.drop_duplicates("method")
    own = style.own_styles(named.loc[~named["name"].isin(_FAMILIES), "method"])
    looks: dict[str, MethodStyle] = {}
    used: dict[tuple[str, ...], int] = {}
    for label, name, refined in zip(named["method"], named["name"], named["refined"], strict=True):
        dashes = (0, (3, 1.5)) if refined else "-"
        if label in own:
            looks[label] = own[label]._replace(dashes=dashes)
            continue
        shades = _FAMILIES[name]
        used[shades] = used.get(shades, -1) + 1
        color, marker = shades[used[shades] % len(shades)], _MARKERS[len(looks) % len(_MARKERS)]
        looks[label] = MethodStyle(label, color, marker, style.SYMBOLS[marker], dashes=dashes)
    return looks
