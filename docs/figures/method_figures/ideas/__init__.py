"""One figure per method that shows its idea on a small example."""

from __future__ import annotations

from typing import TYPE_CHECKING

from method_figures.ideas.graphs import clipper, gc, mac, teaser
from method_figures.ideas.hypotheses import lc, ransac, turboreg
from method_figures.ideas.matrices import gtm, sc2pcr, st
from method_figures.ideas.scores import nnsr, ss
from method_figures.ideas.votes import cv, hough3d, si

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from matplotlib.figure import Figure

IDEAS: Mapping[str, Callable[[], Figure]] = {
    draw.__name__: draw
    for draw in (ss, nnsr, si, cv, ransac, st, gc, hough3d, gtm, lc, mac, sc2pcr, turboreg, teaser, clipper)
}
"""How the idea of each method is drawn, by the function's name."""
