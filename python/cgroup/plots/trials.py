"""Grouping methods on one set of problems: share of registered ones beside the time they take."""

# Parts of matplotlib's methods are untyped. pandas ships no types, and guesses about it are often wrong.
# pyright: reportUnknownMemberType=false, reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.plots.curves import finish, marker_size, panels, sort_methods
from cgroup.plots.style import TEXT, as_it_is, method_styles

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd
    from matplotlib.figure import Figure

    from cgroup.plots.style import MethodStyle


def trials_figure(
    frame: pd.DataFrame, *, title: str, styles: Mapping[str, MethodStyle] | None = None
) -> Figure:
    """Draw the share of problems that methods register, and mean F, over median time.

    Parameters
    ----------
    frame : DataFrame
        `method, right, f_score, seconds`, one row per problem and method.
    title : str
        Shown on top.
    styles : mapping of str to MethodStyle, optional
        How methods are drawn, as `style.method_styles` chooses it for a whole report; for those of this
        figure by default.

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
    looks = method_styles(frame["method"].unique(), styles)
    for each, column, label in zip(axes, ("right", "f_score"), ("registered", "mean F"), strict=True):
        finish(each, title=label, xlabel="median milliseconds per call", share=True)
        each.set_xscale("log")
        for method in sort_methods(looks):
            rows, style = frame[frame["method"] == method], looks[method]
            milliseconds = 1e3 * rows["seconds"].median()
            share = float(rows[column].mean())
            look = {
                "color": style.color,
                "marker": style.marker,
                "linestyle": "",
                "markersize": 1.3 * marker_size(style),
            }
            name = as_it_is(style.label)
            each.plot([milliseconds], [share], **look, label=name, clip_on=False)
            each.annotate(
                name, (milliseconds, share), xytext=(4, 3), textcoords="offset points", fontsize=6.5
            )
    axes[0].set_ylabel("share", fontsize=8, color=TEXT)
    return figure
