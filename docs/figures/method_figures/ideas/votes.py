"""SI, CV and 3DHV: matches vote for each other, or for a place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Rectangle

import cgroup
from cgroup.plots.style import CORRECT, QUIET_TEXT, TEXT, WRONG
from method_figures.drawing import (
    ACCENT,
    FONT,
    colors_of,
    draw_histogram,
    finish,
    mark_cut,
    name_right_and_wrong,
    new_figure,
)
from method_figures.example import small_problem

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cgroup.datasets import MatchingProblem
    from cgroup.types import BoolArray, FloatArray, IndexArray

_COUNTS = LinearSegmentedColormap.from_list("counts", ["#ffffff", "#cfe3f2", ACCENT])


def _problem() -> MatchingProblem:
    return small_problem(240, 0.25, seed=3, noise=1.0, radius=100.0)


def _candidates(problem: MatchingProblem, scores: FloatArray) -> tuple[int, int]:
    """Return a correct and a wrong match with median scores."""
    return _usual(problem.inlier_mask, scores), _usual(~problem.inlier_mask, scores)


def _usual(chosen: BoolArray, scores: FloatArray) -> int:
    """Pick the match of a score that is exceeded by two in five of those chosen."""
    rows = np.flatnonzero(chosen)
    return int(rows[np.argsort(scores[rows])[int(0.6 * len(rows))]])


def _votes(method: str, option: str, draw: Callable[..., None], *, of: str, title: str) -> Figure:
    """Draw 60 voters of a correct and of a wrong match, and the scores of all matches."""
    problem = _problem()
    result = cgroup.group(problem.correspondences(), method, **{option: 60})
    scores = np.asarray(result.scores)
    figure = new_figure(2.9)
    *pair, third = figure.subplots(1, 3)
    voters = np.argsort(problem.ratio, kind="stable")[:60]
    for axes, match, name in zip(pair, _candidates(problem, scores), ("correct", "wrong"), strict=True):
        draw(axes, problem, match, voters[voters != match])
        finish(
            axes,
            title=of.format(name=name, score=scores[match]),
            xlabel=axes.get_xlabel(),
            ylabel=axes.get_ylabel() if axes is pair[0] else "",
            grid=method == "si",
        )
    draw_histogram(third, scores, problem.inlier_mask, bins=np.linspace(0, scores.max(), 25))
    mark_cut(third, result.threshold or 0.0, "Otsu's cut")
    finish(third, title=title, xlabel="$s(c)$", ylabel="matches")
    name_right_and_wrong(figure)
    return figure


def si() -> Figure:
    """Draw global voters of a correct and of a wrong match, and the fractions of votes."""
    return _votes("si", "neighbors", _draw_residuals, of="Votes for a {name} match", title="Share of votes")


def cv() -> Figure:
    """Draw the weight of a vote, and the votes for a correct and a wrong match."""
    title = "Votes for a {name} match: {score:.1f}"
    return _votes("cv", "voters", _draw_agreement, of=title, title="Sum of votes")


def _draw_residuals(axes: Axes, problem: MatchingProblem, match: int, others: IndexArray) -> None:
    """Draw each voter by its residual under the candidate's own pose, and by its distance ratio."""
    rotation = problem.target_lrf[match].T @ problem.source_lrf[match]
    moved = (problem.source[others] - problem.source[match]) @ rotation.T + problem.target[match]
    residual = np.linalg.norm(moved - problem.target[others], axis=1)
    ratio = _distance_ratio(problem, match)[others]
    axes.add_patch(Rectangle((0.5, 0.9), 4.5, 0.1, color=ACCENT, alpha=0.15, linewidth=0))
    axes.scatter(
        np.clip(residual, 0.6, 400),
        ratio,
        s=14,
        color=colors_of(problem.inlier_mask[others]),
        alpha=0.8,
        linewidths=0,
    )
    count = int(((residual < 5) & (ratio > 0.9)).sum())
    axes.set_xscale("log")
    axes.set(xlim=(0.5, 450), ylim=(0, 1.04))
    axes.set(xlabel="residual under its pose (pr)", ylabel=r"distance ratio $r$")
    axes.text(
        0.04,
        0.05,
        f"{count} of {len(others)} global voters\nin the blue corner",
        transform=axes.transAxes,
        fontsize=FONT - 0.5,
        color=TEXT,
    )


def _distance_ratio(problem: MatchingProblem, match: int) -> FloatArray:
    source = np.linalg.norm(problem.source - problem.source[match], axis=1)
    target = np.linalg.norm(problem.target - problem.target[match], axis=1)
    longer = np.maximum(np.maximum(source, target), 1e-9)
    return np.minimum(source, target) / longer


def _draw_agreement(axes: Axes, problem: MatchingProblem, match: int, others: IndexArray) -> None:
    """Draw each voter by its two differences, over the weight that they give."""
    reach, turn = 40.0, 60.0
    grid_r, grid_l = np.meshgrid(np.linspace(0, reach, 120), np.linspace(0, turn, 120))
    weight = np.exp(-((grid_r / 10) ** 2) - (grid_l / 10) ** 2)
    axes.pcolormesh(grid_r, grid_l, weight, cmap=_COUNTS, vmin=0, vmax=1.2, rasterized=True)
    source = np.linalg.norm(problem.source[others] - problem.source[match], axis=1)
    target = np.linalg.norm(problem.target[others] - problem.target[match], axis=1)
    differ = np.abs(_angles(problem.source_lrf, match, others) - _angles(problem.target_lrf, match, others))
    axes.scatter(
        np.minimum(np.abs(source - target), reach),
        np.minimum(differ, turn),
        s=14,
        color=colors_of(problem.inlier_mask[others]),
        alpha=0.85,
        linewidths=0,
        clip_on=False,
        zorder=3,
    )
    axes.set(xlim=(0, reach), ylim=(0, turn))
    axes.set(xlabel=r"distances differ by $r$ (pr)", ylabel="frames differ by $L$ (degrees)")
    axes.set_xticks([0, 10, 20, 30, reach], ["0", "10", "20", "30", "40+"])
    axes.set_yticks([0, 20, 40, turn], ["0", "20", "40", "60+"])
    axes.text(0.6 * reach, 0.9 * turn, "blue: vote near 1", fontsize=FONT - 1, color=QUIET_TEXT, ha="center")


def _angles(frames: FloatArray, match: int, others: IndexArray) -> FloatArray:
    """Degrees between the frame of one match and those of others, Eq. (9)."""
    traces = np.einsum("ab,nab->n", frames[match], frames[others])
    return np.degrees(np.arccos(np.clip((traces - 1) / 2, -1, 1)))


def hough3d() -> Figure:
    """Draw how a vote is cast, and the votes in the slice of Hough space that holds the peak."""
    problem = small_problem(300, 0.3, seed=8, noise=1.0, radius=100.0)
    votes = _cast(problem)
    low, high = votes.min(axis=0), votes.max(axis=0)
    index = np.clip(((votes - low) / (high - low) * 15).astype(int), 0, 14)
    counts = np.zeros((15, 15, 15), dtype=int)
    np.add.at(counts, tuple(index.T), 1)
    peak = np.unravel_index(counts.argmax(), counts.shape)
    figure = new_figure(3.7)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.05))
    for chosen, color in ((~problem.inlier_mask, WRONG), (problem.inlier_mask, CORRECT)):
        left.scatter(*votes[chosen, :2].T, s=9, color=color, alpha=0.75, linewidths=0)
    left.set_aspect("equal")
    left.set_anchor("E")
    finish(left, title="Where each match puts the source's centre", xlabel="x (pr)", ylabel="y (pr)")
    image = counts[:, :, peak[2]].T
    edges = [np.linspace(low[axis], high[axis], 16) for axis in (0, 1)]
    mesh = right.pcolormesh(*edges, image, cmap=_COUNTS, edgecolors="#dddddd", linewidth=0.4)
    for shift in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
        _frame_bin(right, edges, (peak[0] + shift[0], peak[1] + shift[1]), strong=shift == (0, 0))
    right.set_aspect("equal")
    right.set_anchor("W")
    right.set(xlim=left.get_xlim(), ylim=left.get_ylim())
    finish(right, title="Votes per bin, in the peak's layer", xlabel="x (pr)", ylabel="", grid=False)
    bar = figure.colorbar(mesh, ax=right, shrink=0.8, pad=0.02)
    bar.ax.tick_params(labelsize=FONT - 1, color=QUIET_TEXT)
    bar.outline.set_visible(False)
    name_right_and_wrong(figure)
    return figure


def _cast(problem: MatchingProblem) -> FloatArray:
    """Eq. (14) to (16): the source's centre as each match sees it in the target."""
    local = np.einsum("nab,nb->na", problem.source_lrf, problem.source_centroid - problem.source)
    return np.einsum("nba,nb->na", problem.target_lrf, local) + problem.target


def _frame_bin(axes: Axes, edges: list[FloatArray], place: tuple[int, int], *, strong: bool) -> None:
    if not all(0 <= where < 15 for where in place):
        return
    x, y = edges[0][place[0]], edges[1][place[1]]
    size = edges[0][1] - edges[0][0], edges[1][1] - edges[1][0]
    axes.add_patch(
        Rectangle(
            (x, y),
            *size,
            fill=False,
            edgecolor=TEXT,
            linewidth=1.6 if strong else 0.9,
            zorder=4 if strong else 3,
        )
    )
