"""Figures of results, for their method `plot`."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.plots.matches import matches_figure, registration_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cgroup._show.drawing import Drawing


def figure_of(drawing: Drawing) -> Figure:
    """Draw what a result is made of."""
    if drawing.is_placed and drawing.correct is None:
        return registration_figure(
            drawing.source,
            drawing.target,
            drawing.matches,
            mask=drawing.mask,
            T_target_source=drawing.pose,
            title=drawing.title,
        )
    return matches_figure(
        drawing.source,
        drawing.target,
        drawing.matches,
        mask=drawing.mask,
        T_target_source=drawing.pose,
        correct=drawing.correct,
        title=drawing.title,
    )
