"""Time over the number of matches."""

# Parts of matplotlib's methods are untyped. pandas ships no types, and guesses about it are often wrong.
# pyright: reportUnknownMemberType=false, reportArgumentType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D

from cgroup.plots import style
from cgroup.plots.curves import draw_curves, finish, marker_size, panels, sort_methods

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd
    from matplotlib.figure import Figure


def timing_figure(
    times: pd.DataFrame, *, exponents: Mapping[str, float], complexities: Mapping[str, str], title: str
) -> Figure:
    """Draw seconds over the number of matches on logarithmic axes.

    Parameters
    ----------
    times : DataFrame
        Mean seconds: one row per number of matches, one column per method.
    exponents : mapping of str to float
        Exponent a of ``seconds ~ n^a`` fitted to each method, NaN where none could be fitted.
    complexities : mapping of str to str
        What the paper's table says of each method, for comparison.
    title : str
        Shown on top.

    Returns
    -------
    Figure
        The legend names exponents and complexities, slowest method first.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.plots import timing_figure
    >>> times = pd.DataFrame(
    ...     {"gc": [0.001, 0.004], "gtm": [0.01, 0.04]}, index=[1000, 2000]
    ... )
    >>> figure = timing_figure(
    ...     times, exponents={"gc": 2.0, "gtm": 2.0}, complexities={}, title="Time"
    ... )
    >>> figure.savefig("times.png")
    """
    figure, (axes,) = panels(1, columns=1, title=title, extra=1.5)
    draw_curves(axes, times)
    axes.set_xscale("log")
    axes.set_yscale("log")
    finish(axes, xlabel="number of matches n", ylabel="seconds per grouping, one thread")
    sizes = list(times.index)
    axes.set_xticks(sizes, [f"{n:,}" for n in sizes])
    axes.tick_params(axis="x", rotation=30)
    axes.minorticks_off()
    last = times.ffill().iloc[-1]
    names = sorted(sort_methods(times.columns), key=lambda method: -last[method])
    handles = [
        Line2D(
            [],
            [],
            color=style.method_style(method).color,
            marker=style.method_style(method).marker,
            linestyle=style.method_style(method).dashes,
            linewidth=1.1,
            markersize=marker_size(style.method_style(method).marker),
            label=_label(method, exponents.get(method, np.nan), complexities.get(method)),
        )
        for method in names
    ]
    figure.legend(handles=handles, loc="outside right upper", frameon=False, fontsize=8, handlelength=2.4)
    return figure


def _label(method: str, exponent: float, paper: str | None) -> str:
    """Name a method with its measured exponent and the paper's complexity."""
    fitted = "" if np.isnan(exponent) else f"  $n^{{{exponent:.2f}}}$"
    return f"{style.method_style(method).label}{fitted}" + (f"  (paper {paper})" if paper else "")
