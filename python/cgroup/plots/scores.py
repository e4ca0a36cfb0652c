"""Scores of methods against each other."""

# Parts of matplotlib's methods are untyped.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from cgroup._checks.values import as_named
from cgroup.plots import style
from cgroup.plots.charts import marker_size

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cgroup.evaluation import GroupScore
    from cgroup.plots.style import MethodStyle

_F_LEVELS = (0.2, 0.4, 0.6, 0.8)


def precision_recall_figure(
    scores: Mapping[str, GroupScore], *, title: str, styles: Mapping[str, MethodStyle] | None = None
) -> Figure:
    """Draw precision over recall, one marker per method, over lines of equal F.

    Parameters
    ----------
    scores : mapping of str to GroupScore
        By the method's name; one marker each.
    title : str
        Shown on top.
    styles : mapping of str to MethodStyle, optional
        How methods are drawn, as `style.method_styles` chooses it for a whole report; for those of this
        figure by default.

    Returns
    -------
    Figure
        Up and to the right is better.

    Raises
    ------
    InputError
        For scores or styles that aren't by name.

    Examples
    --------
    >>> from cgroup.evaluation import GroupScore
    >>> from cgroup.plots import precision_recall_figure
    >>> scores = {"gtm": GroupScore(100, 20, 16, 15), "gc": GroupScore(100, 20, 30, 18)}
    >>> figure = precision_recall_figure(scores, title="Two methods")
    >>> figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()
    ('recall', 'precision')
    """
    as_named("scores", scores, "give a dict of GroupScore by the name of the method")
    as_named("styles", styles or {}, "give a dict of MethodStyle by the name of the method")
    figure = Figure(figsize=(6.4, 4.8), dpi=style.DOTS_PER_INCH, layout="constrained")
    axes = figure.subplots()
    for level in _F_LEVELS:
        recall = np.linspace(level / (2 - level), 1, 100)
        precision = level * recall / (2 * recall - level)
        axes.plot(recall, precision, color="#cccccc", linewidth=0.8, zorder=1)
        end = f"F {level:g}"
        axes.annotate(end, (1, precision[-1]), xytext=(3, 0), textcoords="offset points",
                      fontsize=8, va="center", color=style.QUIET_TEXT)  # fmt: skip
    looks, handles = style.method_styles(scores, styles), {}
    for method, score in scores.items():
        look = looks[method]
        handles[style.as_it_is(look.label)] = axes.scatter(
            score.recall,
            score.precision,
            color=look.color,
            marker=look.marker,
            s=18 * marker_size(look),
            edgecolors="white",
            linewidths=0.6,
            zorder=3,
            clip_on=False,
        )
    axes.set(xlim=(0, 1), ylim=(0, 1), xlabel="recall", ylabel="precision", aspect="equal")
    axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(title, color=style.TEXT, fontsize=11)
    figure.legend(
        list(handles.values()),
        list(handles),
        fontsize=min(10, 215 / len(handles)),
        loc="outside right upper",
        frameon=False,
    )
    return figure
