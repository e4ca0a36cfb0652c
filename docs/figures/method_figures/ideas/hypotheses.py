"""RANSAC, LC and TurboReg: motions are proposed, and the one with the most support wins."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.ticker import MaxNLocator

import cgroup
from cgroup import _core
from cgroup.plots.style import CORRECT, QUIET_TEXT, TEXT, WRONG
from cgroup.rigid import apply
from method_figures.drawing import (
    ACCENT,
    FONT,
    finish,
    name_below,
    name_right_and_wrong,
    new_figure,
)
from method_figures.example import FlatView, bare, small_problem, title_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cgroup.datasets import MatchingProblem
    from cgroup.types import FloatArray, IndexArray

_TOLERANCE = 5.0  # pr


def _residuals(problem: MatchingProblem, rows: IndexArray) -> FloatArray:
    """Residuals of all matches under the motion of some."""
    motion = _core.rigid_fit(problem.source[rows], problem.target[rows])
    return np.linalg.norm(apply(motion, problem.source) - problem.target, axis=1)


def ransac() -> Figure:
    """Draw a bad sample and a good one, and how many agree with each of many."""
    problem = small_problem(60, 0.4)
    rng = np.random.default_rng(5)
    samples = [rng.choice(len(problem), 3, replace=False) for _ in range(120)]
    counts = np.array([(_residuals(problem, rows) < _TOLERANCE).sum() for rows in samples])
    figure = new_figure(3.0)
    left, middle, axes = figure.subplots(1, 3, width_ratios=(1, 1, 1.25))
    order = np.argsort(counts, kind="stable")
    clean = [all(problem.inlier_mask[rows]) for rows in samples]
    bad = next(number for number in order[::-1] if problem.inlier_mask[samples[number]].sum() == 1)
    for panel, number, name in (
        (left, bad, "Two wrong matches"),
        (middle, order[-1], "Three correct matches"),
    ):
        _draw_sample(panel, problem, samples[number])
        title_of(panel, f"{name}: {counts[number]} agree")
    places = np.arange(1, len(counts) + 1)
    axes.scatter(
        places,
        counts,
        s=10,
        color=[CORRECT if each else WRONG for each in clean],
        linewidths=0,
        alpha=0.85,
        zorder=3,
    )
    axes.step(places, np.maximum.accumulate(counts), where="post", color=TEXT, linewidth=1.2)
    axes.set_ylim(0, None)
    finish(axes, title="Inliers of each sample", xlabel="iteration", ylabel="matches within the tolerance")
    best = Line2D([], [], color=TEXT, linewidth=1.2, label="best so far")
    name_right_and_wrong(figure, best)
    return figure


def _draw_sample(axes: Axes, problem: MatchingProblem, rows: IndexArray) -> None:
    """Draw the target, and the source transformed by the motion of the sample."""
    view = FlatView(problem)
    motion = _core.rigid_fit(problem.source[rows], problem.target[rows])
    laid, target = view.target(apply(motion, problem.source)), view.target()
    agree = _residuals(problem, rows) < _TOLERANCE
    axes.scatter(*target.T, s=16, color="#9a9a9a", linewidths=0, zorder=2)
    axes.scatter(*laid.T, s=16, facecolors="none", edgecolors=ACCENT, linewidths=0.8, zorder=3)
    lines = np.stack([laid[~agree], target[~agree]], axis=1)
    axes.add_collection(LineCollection(list(lines), colors="#cccccc", linewidths=0.5, zorder=1))
    colors = [CORRECT if problem.inlier_mask[row] else WRONG for row in rows]
    axes.scatter(*target[rows].T, s=60, facecolors="none", edgecolors=colors, linewidths=2.0, zorder=5)
    axes.add_patch(Polygon(target[rows], fill=False, edgecolor=TEXT, linewidth=0.8, zorder=4))
    everything = np.vstack([laid, target])
    axes.set(
        xlim=(everything[:, 0].min() - 4, everything[:, 0].max() + 4),
        ylim=(everything[:, 1].min() - 4, everything[:, 1].max() + 4),
    )
    bare(axes)


def lc() -> Figure:
    """Draw a match's support of a pose over its residual, and the supported poses."""
    problem = small_problem(1000, 0.02, seed=6, noise=1.2, radius=100.0)
    result = cgroup.group(problem.correspondences(), "lc")
    figure = new_figure(3.0)
    left, middle, right = figure.subplots(1, 3)
    residual = np.linspace(0, 7, 200)
    for level, name, color in (
        (5.0, "distinctive", TEXT),
        (3.2, "usual", ACCENT),
        (1.0, "in a crowd", QUIET_TEXT),
    ):
        gain = np.where(residual < 6, np.maximum(0, level - residual**2 / (2 * 2.7**2)), 0)
        left.plot(residual, gain, color=color, linewidth=1.5)
        left.annotate(
            name, (0, level), xytext=(4, 3), textcoords="offset points", fontsize=FONT - 0.5, color=color
        )
    left.set(xlim=(0, 7), ylim=(0, 5.9))
    finish(
        left,
        title="What a match adds",
        xlabel=r"residual $r_i$ ($\tau / 3$)",
        ylabel="support",
    )
    _draw_modes(middle, problem, result)
    _draw_residuals(right, problem, result)
    name_right_and_wrong(figure, dots=False)
    return figure


def _draw_modes(axes: Axes, problem: MatchingProblem, result: cgroup.Grouping) -> None:
    poses, scores = np.asarray(result.alternatives), np.asarray(result.alternative_scores)
    shown = min(12, len(scores))
    right = [
        np.median(
            np.linalg.norm(
                apply(pose, problem.source) - apply(problem.T_target_source, problem.source), axis=1
            )
        )
        < _TOLERANCE
        for pose in poses[:shown]
    ]
    axes.bar(
        np.arange(1, shown + 1),
        scores[:shown],
        color=[CORRECT if each else WRONG for each in right],
        width=0.75,
        alpha=0.8,
    )
    axes.text(
        0.97,
        0.93,
        f"false alarms: {result.false_alarms:.0e}",
        transform=axes.transAxes,
        ha="right",
        fontsize=FONT - 0.5,
        color=TEXT,
    )
    finish(axes, title="Support of each pose", xlabel="pose (mode)", ylabel="")


def _draw_residuals(axes: Axes, problem: MatchingProblem, result: cgroup.Grouping) -> None:
    residual = np.linalg.norm(apply(np.asarray(result.model), problem.source) - problem.target, axis=1)
    edges = np.arange(0, 31)
    axes.hist(
        [np.clip(residual[~problem.inlier_mask], 0, 99), residual[problem.inlier_mask]],
        bins=list(edges),
        stacked=True,
        color=[WRONG, CORRECT],
        alpha=0.8,
        rwidth=0.9,
    )
    axes.axvspan(0, 5, color=ACCENT, alpha=0.12, linewidth=0)
    axes.text(5.4, axes.get_ylim()[1] * 0.92, "the group", fontsize=FONT - 0.5, color=ACCENT, va="top")
    finish(axes, title="Residuals under the best one", xlabel="residual (pr)", ylabel="matches")


def turboreg() -> Figure:
    """Draw the weights of pairs, and a triangle over a heavy pair, which defines a pose."""
    problem = small_problem(150, 0.15, seed=7, noise=0.4, radius=60.0)
    weight = _second_order(problem, 1.6, 60.0)
    pairs = np.argwhere(np.triu(weight, 1) > 0)
    heavy = weight[tuple(pairs.T)]
    both = problem.inlier_mask[pairs].all(axis=1)
    order = np.argsort(-heavy, kind="stable")
    figure = new_figure(3.1)
    left, axes = figure.subplots(1, 2, width_ratios=(1.35, 1))
    pivot = pairs[order[0]]
    third = _best_third(weight, pivot)
    _draw_triangle(left, problem, np.array([*pivot, third]))
    title_of(left, "A pivot (thick) and its heaviest triangle")
    places = np.arange(1, len(order) + 1)
    for chosen, color in ((~both, WRONG), (both, CORRECT)):
        mask = chosen[order]
        axes.scatter(places[mask], heavy[order][mask], s=8, color=color, linewidths=0, alpha=0.8)
    axes.set_xscale("log")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    finish(
        axes,
        title="Pairs by weight: pivots are the first",
        xlabel="pair, heaviest first",
        ylabel="others compatible with both",
    )
    handles = [
        Line2D([], [], color=color, marker="o", linestyle="", markersize=5, label=name)
        for name, color in (("both are correct", CORRECT), ("at least one is wrong", WRONG))
    ]
    name_below(figure, handles)
    return figure


def _second_order(problem: MatchingProblem, bound: float, shortest: float) -> FloatArray:
    source, target = (
        np.linalg.norm(side[:, None] - side[None, :], axis=2) for side in (problem.source, problem.target)
    )
    joined = (np.abs(source - target) < bound) & (source + target > shortest)
    return joined * (joined.astype(float) @ joined)


def _best_third(weight: FloatArray, pivot: IndexArray) -> int:
    first, second = weight[pivot[0]], weight[pivot[1]]
    return int(np.where((first > 0) & (second > 0), first + second, -1).argmax())


def _draw_triangle(axes: Axes, problem: MatchingProblem, rows: IndexArray) -> None:
    view = FlatView(problem)
    chosen = np.zeros(len(problem), dtype=bool)
    chosen[rows] = True
    view.draw(axes, chosen, width=1.3)
    for points in (view.source(), view.target()):
        axes.add_patch(Polygon(points[rows], color=CORRECT, alpha=0.18, linewidth=0, zorder=3))
        axes.plot(*points[rows[:2]].T, color=TEXT, linewidth=2.2, zorder=5)
        for row in rows[:2]:
            axes.plot(*points[[row, rows[2]]].T, color=TEXT, linewidth=0.9, zorder=5)
    view.name_sides(axes)
