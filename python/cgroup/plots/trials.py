"""Grouping methods on one set of problems: share of registered ones beside the time they take."""

# Parts of matplotlib's methods are untyped. pandas ships no types, and guesses about it are often wrong.
# pyright: reportUnknownMemberType=false, reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.plots.curves import finish, panels, sort_methods
from cgroup.plots.style import TEXT, method_style

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure


def trials_figure(frame: pd.DataFrame, *, title: str) -> Figure:
    """Draw the share of problems that methods register, and mean F, over median time.

    Parameters
    ----------
    frame : DataFrame
        `method, right, f_score, seconds`, one row per problem and method.
    title : str
        Shown on top.

    Returns
    -------
    Figure
        Two panels, one point per method.

    Raises
    ------
    KeyError
        For rows that lack a column.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.plots import trials_figure
    >>> frame = pd.DataFrame(
    ...     {"method": ["gc", "gtm"], "right": [False, True], "f_score": [0.6, 0.9]}
    ... )
    >>> figure = trials_figure(frame.assign(seconds=[0.001, 0.01]), title="Two methods")
    >>> [axes.get_title(loc="left") for axes in figure.axes]
    ['registered', 'mean F']
    """
    figure, axes = panels(2, columns=2, title=title, extra=0.2)
    methods = sort_methods(frame["method"].unique())
    for each, column, label in zip(axes, ("right", "f_score"), ("registered", "mean F"), strict=True):
        finish(each, title=label, xlabel="median milliseconds per call", share=True)
        each.set_xscale("log")
        for method in methods:
            rows, style = frame[frame["method"] == method], method_style(method)
            milliseconds = 1e3 * rows["seconds"].median()
            share = float(rows[column].mean())
            look = {"color": style.color, "marker": style.marker, "linestyle": "", "markersize": 6}
            each.plot([milliseconds], [share], **look, label=style.label, clip_on=False)
            each.annotate(
                style.label, (milliseconds, share), xytext=(4, 3), textcoords="offset points", fontsize=6.5
            )
    axes[0].set_ylabel("share", fontsize=8, color=TEXT)
    return figure
