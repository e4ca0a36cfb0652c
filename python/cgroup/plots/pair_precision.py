"""Precision pair by pair of two methods."""

# Parts of matplotlib's methods are untyped. pandas ships no types, and guesses about it are often wrong.
# pyright: reportArgumentType=false, reportCallIssue=false, reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.evaluation.metrics import REGISTERED_PRECISION
from cgroup.plots import style
from cgroup.plots.curves import finish, legend, marker_size, panels

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd
    from matplotlib.figure import Figure

    from cgroup.plots.style import MethodStyle


def pair_precision_figure(
    rows: pd.DataFrame,
    *,
    methods: tuple[str, str],
    title: str,
    styles: Mapping[str, MethodStyle] | None = None,
) -> Figure:
    """Draw the precision of two methods on every pair.

    Parameters
    ----------
    rows : DataFrame
        Records with the columns ``pair``, ``method`` and ``precision``, one per pair and method.
    methods : tuple of str
        Two of them; pairs are sorted by the precision of the second.
    title : str
        Shown on top.
    styles : mapping of str to MethodStyle, optional
        How methods are drawn, as `style.method_styles` chooses it for a whole report; for those of this
        figure by default.

    Returns
    -------
    Figure
        Left pair by pair, right the share of pairs up to each precision.

    Raises
    ------
    KeyError
        For records that lack a column, or one of the methods.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.plots import pair_precision_figure
    >>> rows = pd.DataFrame(
    ...     {"pair": ["a", "b"] * 2, "method": ["gc", "gc", "gtm", "gtm"]}
    ... )
    >>> rows = rows.assign(precision=[0.4, 0.7, 0.9, 0.95])
    >>> figure = pair_precision_figure(rows, methods=("gc", "gtm"), title="Two methods")
    >>> len(figure.axes)
    2
    """
    table = rows.pivot_table(index="pair", columns="method", values="precision")[list(methods)].dropna()
    table = table.sort_values([methods[1], methods[0]])
    looks = style.method_styles(methods, styles)
    figure, (each, shares) = panels(2, columns=2, title=title, extra=0.4)
    order = np.arange(1, len(table) + 1)
    for method in methods:
        look = looks[method]
        each.plot(
            order, table[method], linestyle="", marker=look.marker, color=look.color,
            markersize=marker_size(look), markeredgecolor="white", markeredgewidth=0.3, clip_on=False,
        )  # fmt: skip
        values = np.concatenate([[0.0], np.sort(table[method].to_numpy()), [1.0]])
        height = np.concatenate([[0.0], order / len(table), [1.0]])
        shares.step(values, height, where="post", color=look.color, linestyle=look.dashes, linewidth=1.4)
    each.axhline(REGISTERED_PRECISION, color=style.QUIET_TEXT, linewidth=0.8, linestyle=":")
    shares.axvline(REGISTERED_PRECISION, color=style.QUIET_TEXT, linewidth=0.8, linestyle=":")
    shares.annotate(
        "registered", (REGISTERED_PRECISION, 0.93), xytext=(3, 0), textcoords="offset points", fontsize=7,
        color=style.QUIET_TEXT,
    )  # fmt: skip
    second = style.as_it_is(looks[methods[1]].label)
    finish(
        each, title="each pair", xlabel=f"pairs, by the precision of {second}", ylabel="precision", share=True
    )
    finish(shares, title="all pairs", xlabel="precision", ylabel="share of pairs up to it", share=True)
    shares.set_xlim(0, 1)
    legend(figure, looks)
    return figure
