"""Small matching problems that ideas are shown on, and a flat picture of their two sides."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection

from cgroup.datasets import MatchingProblem, make_problem
from cgroup.plots.style import CORRECT, QUIET_TEXT, TEXT, WRONG
from cgroup.rigid import apply, invert
from method_figures.drawing import FONT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cgroup.types import BoolArray, FloatArray

_TURN = np.radians(-28)
_GAP = 2.35  # between the two sides, in units of the shape's radius


@cache
def small_problem(
    n: int = 60, share: float = 0.3, *, seed: int = 4, noise: float = 0.6, radius: float = 40.0
) -> MatchingProblem:
    """Return a small problem, correct matches first."""
    problem = make_problem(
        np.random.default_rng(seed),
        n,
        inlier_ratio=share,
        noise=noise,
        radius=radius,
        random_frames=0.1,
        frame_error=4.0,
        repeated_targets=0.0,
    )
    return problem.subset(np.argsort(~problem.inlier_mask, kind="stable"))


class FlatView:
    """The two sides of a problem in one plane: the target on the right, turned a little."""

    def __init__(self, problem: MatchingProblem) -> None:
        self._problem = problem
        self._center = problem.source.mean(axis=0)
        self._shift = _GAP * float(np.abs(problem.source - self._center).max())

    def source(self) -> FloatArray:
        """Place the points of the source."""
        return (self._problem.source - self._center)[:, :2]

    def target(self, points: FloatArray | None = None) -> FloatArray:
        """Place points of the target; all by default."""
        shown = self._problem.target if points is None else points
        back = apply(invert(self._problem.T_target_source), shown) - self._center
        cosine, sine = np.cos(_TURN), np.sin(_TURN)
        turned = back[:, :2] @ np.array([[cosine, sine], [-sine, cosine]])
        return turned + np.array([self._shift, 0.0])

    def draw(
        self, axes: Axes, rows: BoolArray | None = None, *, width: float = 0.9, alpha: float = 0.8
    ) -> None:
        """Draw both sides' points, and lines of some matches in the colours of correct and wrong."""
        shown = np.ones(len(self._problem), dtype=bool) if rows is None else rows
        first, second = self.source(), self.target()
        for points in (first, second):
            axes.scatter(*points.T, s=9, color="#b5b5b5", linewidths=0, zorder=2)
        for right, color in ((False, WRONG), (True, CORRECT)):
            chosen = shown & (self._problem.inlier_mask == right)
            lines = np.stack([first[chosen], second[chosen]], axis=1)
            axes.add_collection(
                LineCollection(list(lines), colors=color, linewidths=width, alpha=alpha, zorder=3)
            )
            for points in (first, second):
                axes.scatter(*points[chosen].T, s=12, color=color, linewidths=0, zorder=4)
        bare(axes)

    def name_sides(self, axes: Axes) -> None:
        """Write which side is which."""
        low = min(self.source()[:, 1].min(), self.target()[:, 1].min())
        for points, name in ((self.source(), "source"), (self.target(), "target")):
            axes.text(
                points[:, 0].mean(),
                low * 1.08,
                name,
                ha="center",
                va="top",
                fontsize=FONT - 0.5,
                color=QUIET_TEXT,
            )


def bare(axes: Axes) -> None:
    """Leave nothing but the picture, in true proportions."""
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.margins(0.04)


def title_of(axes: Axes, title: str) -> None:
    """Give a picture a title."""
    axes.set_title(title, loc="left", fontsize=FONT + 0.5, color=TEXT)
