"""Figures of ST, GTM and SC2-PCR: matrices of all pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import LinearSegmentedColormap

import cgroup
from cgroup.plots.style import CORRECT, QUIET_TEXT, TEXT, WRONG
from method_figures.drawing import (
    ACCENT,
    FONT,
    colors_of,
    finish,
    name_right_and_wrong,
    new_figure,
)
from method_figures.example import small_problem

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cgroup.datasets import MatchingProblem
    from cgroup.types import FloatArray

BLUES = LinearSegmentedColormap.from_list("agreement", ["#ffffff", "#cfe3f2", ACCENT, "#00314d"])


def distances(problem: MatchingProblem) -> tuple[FloatArray, FloatArray]:
    """Return the distances of all pairs, in the source and in the target."""
    return tuple(
        np.linalg.norm(side[:, None] - side[None, :], axis=2) for side in (problem.source, problem.target)
    )


def ratio_matrix(problem: MatchingProblem) -> FloatArray:
    """Return Eq. (12) for all pairs, 0 on the diagonal."""
    source, target = distances(problem)
    longer = np.maximum(source, target)
    return np.divide(np.minimum(source, target), longer, out=np.zeros_like(longer), where=longer > 0)


def show_matrix(
    axes: Axes, matrix: FloatArray, right: int, title: str, *, greatest: float | None = None
) -> None:
    """Draw a matrix whose first rows and columns are correct matches."""
    axes.imshow(matrix, cmap=BLUES, vmin=0, vmax=greatest, interpolation="nearest")
    size = len(matrix)
    for start, stop, color in ((0, right, CORRECT), (right, size, WRONG)):
        axes.plot([start - 0.5, stop - 0.5], [-2.2, -2.2], color=color, linewidth=3, clip_on=False)
        axes.plot([-2.2, -2.2], [start - 0.5, stop - 0.5], color=color, linewidth=3, clip_on=False)
    axes.set(xlim=(-0.5, size - 0.5), ylim=(size - 0.5, -0.5), xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    axes.set_title(title, loc="left", fontsize=FONT + 0.5, color=TEXT, pad=9)


def st() -> Figure:
    """Draw the affinity matrix, its principal eigenvector, and the accepted matches."""
    problem = small_problem(60, 0.3)
    right = int(problem.inlier_mask.sum())
    result = cgroup.st(problem.source, problem.target)
    vector = np.asarray(result.scores)
    figure = new_figure(3.1)
    left, axes = figure.subplots(1, 2, width_ratios=(1, 1.6))
    show_matrix(left, ratio_matrix(problem) ** 4, right, "Agreement of all pairs, $r^4$")
    order = np.argsort(-vector, kind="stable")
    places = np.arange(len(order))
    kept = result.mask[order]
    colors = np.array(colors_of(problem.inlier_mask[order]))
    axes.bar(places[kept], vector[order][kept], color=list(colors[kept]), width=0.78)
    axes.bar(
        places[~kept],
        vector[order][~kept],
        color="white",
        edgecolor=list(colors[~kept]),
        linewidth=0.9,
        width=0.7,
    )
    finish(
        axes,
        title="Entries of the principal eigenvector, greatest first",
        xlabel="match (empty: in conflict with one accepted before it)",
        ylabel="$v_i$",
    )
    axes.set_ylim(bottom=0)
    name_right_and_wrong(figure)
    return figure


def gtm() -> Figure:
    """Draw the population shares of all matches over the steps."""
    problem = small_problem(60, 0.3)
    payoff = ratio_matrix(problem)
    steps = 100
    shares = np.empty((steps + 1, len(problem)))
    shares[0] = 1 / len(problem)
    for step in range(steps):
        earned = payoff @ shares[step]
        shares[step + 1] = shares[step] * earned / (shares[step] @ earned)
    result = cgroup.gtm(problem.source, problem.target)
    figure = new_figure(3.0)
    left, axes = figure.subplots(1, 2, width_ratios=(1, 1.6))
    show_matrix(left, payoff**4, int(problem.inlier_mask.sum()), r"Payoff of all pairs, $\Pi^4$")
    for row in np.argsort(problem.inlier_mask, kind="stable"):
        right = problem.inlier_mask[row]
        axes.plot(
            np.arange(steps + 1), shares[:, row], color=CORRECT if right else WRONG, linewidth=0.9, alpha=0.75
        )
    axes.axhline(result.threshold or 0.0, color=TEXT, linewidth=1.1, linestyle=(0, (4, 2)))
    axes.annotate(
        "Otsu's cut after 100 steps",
        (steps - 1, result.threshold or 0.0),
        xytext=(0, 3),
        textcoords="offset points",
        ha="right",
        fontsize=FONT - 0.5,
        color=TEXT,
    )
    axes.set(xlim=(0, steps), ylim=(0, None))
    finish(axes, title="Share of the population that plays each match", xlabel="step $t$", ylabel="$x_i(t)$")
    name_right_and_wrong(figure)
    return figure


def sc2pcr() -> Figure:
    """Draw first-order compatibility, where wrong pairs agree too, and the second order, where they don't."""
    problem = small_problem(80, 0.25, seed=2)
    source, target = distances(problem)
    first = (np.abs(source - target) < 5) & ~np.eye(len(problem), dtype=bool)
    second = first * (first.astype(float) @ first)
    right = int(problem.inlier_mask.sum())
    figure = new_figure(3.1)
    axes = figure.subplots(1, 3, width_ratios=(1, 1, 1.25))
    show_matrix(axes[0], 0.7 * first, right, "First order: compatible or not", greatest=1)
    show_matrix(axes[1], second, right, "Second order: common ones")
    pairs = np.triu(first, 1)
    both = problem.inlier_mask[:, None] & problem.inlier_mask[None, :]
    counts = [second[pairs & ~both], second[pairs & both]]
    axes[2].hist(
        counts,
        bins=list(np.arange(0, second.max() + 2) - 0.5),
        stacked=True,
        color=[WRONG, CORRECT],
        alpha=0.8,
    )
    finish(
        axes[2],
        title="Compatible pairs by second order",
        xlabel="others compatible with both",
        ylabel="pairs",
    )
    axes[2].text(
        0.97,
        0.9,
        "green: both are correct",
        transform=axes[2].transAxes,
        ha="right",
        fontsize=FONT - 0.5,
        color=QUIET_TEXT,
    )
    name_right_and_wrong(figure)
    return figure
