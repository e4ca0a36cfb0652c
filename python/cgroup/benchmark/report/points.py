"""Charts beside those over levels: times, pairs one by one, and how often over how fast."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.report.charts import Chart, Look, Panel, Series, dash_of, look_up
from cgroup.benchmark.report.curves import Estimate, estimate_means, make_series
from cgroup.plots.curves import sort_methods
from cgroup.plots.pipelines import OVERLAP_EDGES, choose_looks

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd

    from cgroup.plots.style import MethodStyle

_MILLISECONDS = "median milliseconds per call"


def times_chart(
    times: pd.DataFrame,
    *,
    exponents: Mapping[str, float],
    complexities: Mapping[str, str],
    styles: Mapping[str, MethodStyle],
    alt: str,
) -> Chart:
    """Chart milliseconds over the number of matches.

    Parameters
    ----------
    times : DataFrame
        Mean seconds: one row per number of matches, one column per method.
    exponents : mapping of str to float
        Fitted exponent of each method, NaN where none could be fitted.
    complexities : mapping of str to str
        What the paper's table says.
    styles : mapping of str to MethodStyle
        Of the whole report.
    alt : str
        What the chart shows.

    Returns
    -------
    Chart
        One panel, both axes logarithmic.
    """
    methods = sort_methods(times.columns)
    series = [
        Series(
            method,
            y=(1e3 * times[method]).tolist(),
            notes=[_describe_growth(exponents.get(method, np.nan), complexities.get(method))] * len(times),
        )
        for method in methods
    ]
    panel = Panel(
        "time", "number of matches n", "milliseconds per grouping, one thread", series,
        at=[float(n) for n in times.index], share=False, logarithmic="xy",
    )  # fmt: skip
    return Chart("time", alt, [panel], look_up(methods, styles), ("time",))


def _describe_growth(exponent: float, paper: str | None) -> str:
    measured = "" if np.isnan(exponent) else f"measured n^{exponent:.2f}"
    return "; ".join(filter(None, (measured, paper and f"paper {paper}")))


def pairs_chart(
    rows: pd.DataFrame, methods: tuple[str, str], *, styles: Mapping[str, MethodStyle], alt: str, file: str
) -> Chart:
    """Chart the precision of two methods pair by pair, and the share of pairs up to each precision.

    Parameters
    ----------
    rows : DataFrame
        Records, one per pair and method.
    methods : tuple of str
        Two of them; pairs are sorted by the precision of the second.
    styles : mapping of str to MethodStyle
        Of the whole report.
    alt : str
        What the chart shows.
    file : str
        Figure of the same.

    Returns
    -------
    Chart
        Two panels.
    """
    table = rows.pivot_table(index="pair", columns="method", values="precision")[list(methods)].dropna()
    table = table.sort_values([methods[1], methods[0]])
    order = [float(place) for place in range(1, len(table) + 1)]
    names = [str(name) for name in table.index]
    looks = look_up(methods, styles)
    each = [Series(method, y=table[method].tolist(), x=order, notes=names) for method in methods]
    height = [0.0, *(np.array(order) / len(table)).tolist(), 1.0]
    up_to = [
        Series(method, y=height, x=[0.0, *np.sort(table[method].to_numpy()).tolist(), 1.0])
        for method in methods
    ]
    by = f"pairs, by the precision of {looks[methods[1]].label}"
    panels = [
        Panel("each pair", by, "precision", each, kind="points"),
        Panel("all pairs", "precision", "share of pairs up to it", up_to, kind="lines"),
    ]
    return Chart(file, alt, panels, looks, (file,))


def trials_chart(name: str, related: pd.DataFrame, *, styles: Mapping[str, MethodStyle], alt: str) -> Chart:
    """Chart the share of registered problems, and mean F, over time.

    Parameters
    ----------
    name : str
        Of the chart, and of the figure of the same.
    related : DataFrame
        Rows of `load_trials` of one set that have an answer.
    styles : mapping of str to MethodStyle
        Of the whole report.
    alt : str
        What the chart shows.

    Returns
    -------
    Chart
        Two panels, a point per method.
    """
    methods = sort_methods(related["method"].unique())
    means = estimate_means(related, ("right", "f_score"))
    milliseconds = 1e3 * related.groupby("method")["seconds"].median()
    panels = [
        Panel(
            title, _MILLISECONDS, f"{title} (mean over problems)",
            [
                _make_point(method, float(milliseconds[method]), means[column][method])
                for method in methods
            ],
            kind="points", logarithmic="x",
        )
        for column, title in (("right", "registered"), ("f_score", "F"))
    ]  # fmt: skip
    return Chart(name, alt, panels, look_up(methods, styles), (name,))


def pipelines_chart(related: pd.DataFrame, *, alt: str) -> Chart:
    """Chart how many pairs pipelines register, by overlap and over time.

    Parameters
    ----------
    related : DataFrame
        Rows of `load_registrations` of related pairs without failed ones.
    alt : str
        What the chart shows.

    Returns
    -------
    Chart
        A panel by overlap over all sets, and one over time for each set.
    """
    rows = related.assign(method=related["pipeline"])
    drawn = choose_looks(related)
    looks = {name: Look(name, look.color, look.symbol, dash_of(look.dashes)) for name, look in drawn.items()}
    panels = [_by_overlap(rows, list(looks))] if rows["overlap"].notna().any() else []
    for name, of_set in rows.groupby("set", sort=False):
        means = estimate_means(of_set, ("right",))["right"]
        seconds = of_set.groupby("method")["seconds"].median()
        points = [
            _make_point(method, float(seconds[method]), means[method]) for method in looks if method in means
        ]
        panels.append(
            Panel(
                str(name),
                "median seconds per pair",
                "share of right poses",
                points,
                kind="points",
                logarithmic="x",
            )
        )
    return Chart("registration", alt, panels, looks, ("registration",))


def _by_overlap(rows: pd.DataFrame, pipelines: list[str]) -> Panel:
    classes = list(itertools.pairwise(OVERLAP_EDGES))
    places = np.digitize(rows["overlap"].to_numpy(), OVERLAP_EDGES[1:-1])
    known = rows["overlap"].notna().to_numpy()
    by_class = [
        estimate_means(rows[known & (places == number)], ("right",))["right"]
        if (known & (places == number)).any()
        else {}
        for number in range(len(classes))
    ]
    series = [make_series(name, [of.get(name) for of in by_class]) for name in pipelines]
    middles = [(low + high) / 2 for low, high in classes]
    return Panel("by overlap", "overlap (share), all sets", "share of right poses", series, at=middles)


def _make_point(key: str, place: float, estimate: Estimate) -> Series:
    mean, low, high = estimate.interval
    return Series(key, y=[mean], x=[place], low=[low], high=[high], counts=[estimate.pairs])
