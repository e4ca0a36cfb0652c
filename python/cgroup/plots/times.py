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

    from cgroup.plots.style import MethodStyle


def timing_figure(
    times: pd.DataFrame,
    *,
    exponents: Mapping[str, float],
    complexities: Mapping[str, str],
    title: str,
    styles: Mapping[str, MethodStyle] | None = None,
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
    styles : mapping of str to MethodStyle, optional
        How methods are drawn, as `style.method_styles` chooses it for a whole report; for those of this
        figure by default.

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
    looks = style.method_styles(times.columns, styles)
    draw_curves(axes, times, looks)
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
            color=look.color,
            marker=look.marker,
            linestyle=look.dashes,
            linewidth=1.1,
            markersize=marker_size(look),
            label=_label(look.label, exponents.get(method, np.nan), complexities.get(method)),
        )
        for method, look in ((name, looks[name]) for name in names)
    ]
    figure.legend(handles=handles, loc="outside right upper", frameon=False, fontsize=8, handlelength=2.4)
    return figure


def _label(name: str, exponent: float, paper: str | None) -> str:
    """Name a method with its measured exponent and the paper's complexity."""
    fitted = "" if np.isnan(exponent) else f"  $n^{{{exponent:.2f}}}$"
    return f"{style.as_it_is(name)}{fitted}" + (f"  (paper {paper})" if paper else "")
