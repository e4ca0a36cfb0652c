"""Figures of GC, MAC, TEASER++ and CLIPPER: graphs of matches that agree."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection

import cgroup
from cgroup.plots.style import CORRECT, QUIET_TEXT, TEXT, WRONG
from method_figures.drawing import (
    ACCENT,
    FONT,
    colors_of,
    draw_histogram,
    finish,
    name_right_and_wrong,
    new_figure,
)
from method_figures.example import FlatView, bare, small_problem, title_of
from method_figures.ideas.matrices import distances, show_matrix

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cgroup.datasets import MatchingProblem
    from cgroup.types import BoolArray, IndexArray


def _joined(problem: MatchingProblem, bound: float) -> BoolArray:
    source, target = distances(problem)
    return (np.abs(source - target) < bound) & ~np.eye(len(problem), dtype=bool)


def gc() -> Figure:
    """Draw the largest star, and the sizes of all."""
    problem = small_problem(60, 0.3)
    joined = _joined(problem, 3.0)
    sizes = joined.sum(axis=1) + 1
    seed = int(sizes.argmax())
    members = joined[seed].copy()
    members[seed] = True
    figure = new_figure(3.0)
    left, axes = figure.subplots(1, 2, width_ratios=(1.6, 1))
    view = FlatView(problem)
    view.draw(left, members, width=0.8, alpha=0.5)
    for points in (view.source(), view.target()):
        rays = [(points[seed], points[member]) for member in np.flatnonzero(joined[seed])]
        left.add_collection(LineCollection(rays, colors=TEXT, linewidths=0.6, alpha=0.7, zorder=5))
        left.scatter(*points[seed], s=75, marker="*", color=TEXT, linewidths=0, zorder=6)
    view.name_sides(left)
    title_of(left, f"The largest star: a seed and {sizes[seed] - 1} that keep their distance to it")
    draw_histogram(axes, sizes.astype(float), problem.inlier_mask, bins=np.arange(0.5, sizes.max() + 1.5))
    finish(axes, title="Size of the star of each match", xlabel="members", ylabel="matches")
    name_right_and_wrong(figure)
    return figure


def mac() -> Figure:
    """Draw the graph, its heaviest maximal clique, and the weights of all cliques."""
    problem = small_problem(40, 0.3, seed=4)
    joined = _joined(problem, 4.0)
    cliques = _maximal_cliques(joined)
    weights = np.array([_weight(problem, joined, clique) for clique in cliques])
    order = np.argsort(-weights, kind="stable")
    best = np.array(sorted(cliques[order[0]]))
    figure = new_figure(3.3)
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.25))
    _draw_graph(left, problem, joined, best)
    title_of(left, f"Who agrees with whom; a clique of {len(best)}")
    shown = order[:40]
    right_share = [problem.inlier_mask[list(cliques[number])].mean() for number in shown]
    colors = [CORRECT if share == 1 else WRONG for share in right_share]
    right.bar(np.arange(1, len(shown) + 1), weights[shown], color=colors, width=0.8, alpha=0.85)
    finish(
        right,
        title=f"{len(cliques)} maximal cliques of three and more: each is a pose",
        xlabel="clique, heaviest first (orange: has a wrong match)",
        ylabel="weight",
    )
    name_right_and_wrong(figure)
    return figure


def _maximal_cliques(joined: BoolArray) -> list[set[int]]:
    """List all maximal cliques of three and more members (Bron, Kerbosch 1973, with a pivot)."""
    near = [set(np.flatnonzero(row).tolist()) for row in joined]
    found: list[set[int]] = []

    def grow(clique: set[int], candidates: set[int], seen: set[int]) -> None:
        if not candidates and not seen:
            if len(clique) >= 3:
                found.append(clique)
            return
        pivot = max(candidates | seen, key=lambda vertex: len(near[vertex] & candidates))
        for vertex in sorted(candidates - near[pivot]):
            grow(clique | {vertex}, candidates & near[vertex], seen & near[vertex])
            candidates = candidates - {vertex}
            seen = seen | {vertex}

    grow(set(), set(range(len(near))), set())
    return found


def _weight(problem: MatchingProblem, joined: BoolArray, clique: set[int]) -> float:
    """Sum of the second-order weights over the pairs of a clique."""
    source, target = distances(problem)
    first = np.where(joined, 1 - 0.01 * ((source - target) / 2.0) ** 2, 0.0)
    second = first * (first @ first)
    rows = sorted(clique)
    return float(second[np.ix_(rows, rows)].sum() / 2)


def _draw_graph(axes: Axes, problem: MatchingProblem, joined: BoolArray, clique: IndexArray) -> None:
    """Draw vertices on a circle, correct ones first, and emphasize the clique's edges."""
    size = len(problem)
    angles = np.pi / 2 - 2 * np.pi * np.arange(size) / size
    places = np.column_stack([np.cos(angles), np.sin(angles)])
    inside = np.isin(np.arange(size), clique)
    edges = np.argwhere(np.triu(joined, 1))
    strong = inside[edges].all(axis=1)
    for chosen, color, width, order in ((~strong, "#c9c9c9", 0.6, 1), (strong, ACCENT, 1.1, 2)):
        axes.add_collection(
            LineCollection(list(places[edges[chosen]]), colors=color, linewidths=width, zorder=order)
        )
    axes.scatter(*places.T, s=36, color=colors_of(problem.inlier_mask), linewidths=0, zorder=3)
    axes.scatter(*places[inside].T, s=90, facecolors="none", edgecolors=ACCENT, linewidths=1.4, zorder=4)
    axes.set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15))
    bare(axes)


def teaser() -> Figure:
    """Draw the clique that is kept, the truncated cost, and the vote for one axis of the translation."""
    problem = small_problem(34, 0.3, seed=4)
    joined = _joined(problem, 5.0)
    cliques = _maximal_cliques(joined)
    best = np.array(sorted(max(cliques, key=len)))
    figure = new_figure(3.0)
    left, middle, right = figure.subplots(1, 3, width_ratios=(1, 0.95, 1.15))
    _draw_graph(left, problem, joined, best)
    title_of(left, f"Maximum clique: {len(best)} are kept")
    residual = np.linspace(-3, 3, 301)
    middle.plot(residual, residual**2, color=QUIET_TEXT, linewidth=1.1, linestyle=(0, (4, 2)))
    middle.plot(residual, np.minimum(residual**2, 1), color=ACCENT, linewidth=1.8)
    middle.text(0, 3.05, "least squares", ha="center", fontsize=FONT - 0.5, color=QUIET_TEXT)
    middle.text(0, 1.15, "truncated", ha="center", fontsize=FONT - 0.5, color=ACCENT)
    middle.set(xlim=(-3, 3), ylim=(0, 3.5))
    finish(middle, title="Cost of a residual", xlabel=r"residual / $\beta$", ylabel="cost")
    _draw_vote(right, problem)
    name_right_and_wrong(figure)
    return figure


def _draw_vote(axes: Axes, problem: MatchingProblem) -> None:
    """Draw the interval that each match leaves for the x translation, and the cost along it."""
    rotation = problem.T_target_source[:3, :3]
    proposed = (problem.target - problem.source @ rotation.T)[:, 0] - problem.T_target_source[0, 3]
    beta = 2.5
    shown = np.abs(proposed) < 30
    order = np.argsort(proposed[shown], kind="stable")
    centers, colors = proposed[shown][order], np.array(colors_of(problem.inlier_mask[shown]))[order]
    for height, (center, color) in enumerate(zip(centers, colors, strict=True)):
        axes.plot(
            [center - beta, center + beta],
            [height, height],
            color=color,
            linewidth=2.2,
            solid_capstyle="butt",
        )
    grid = np.linspace(-30, 30, 601)
    cost = np.minimum(((grid[:, None] - proposed) / beta) ** 2, 1).sum(axis=1)
    twin = axes.twinx()
    twin.plot(grid, cost, color=ACCENT, linewidth=1.5)
    twin.set(yticks=[], ylim=(cost.min() - 1, cost.max() + 1))
    twin.spines[:].set_visible(False)
    axes.set(xlim=(-30, 30), yticks=[])
    finish(axes, title="Translation: least cost wins", xlabel="offset from the true one (pr)", grid=False)


def clipper() -> Figure:
    """Draw affinities, ordered by u, and the cut through u."""
    problem = small_problem(60, 0.3)
    result = cgroup.clipper(problem.source, problem.target, resolution=problem.resolution)
    u = np.asarray(result.scores)
    source, target = distances(problem)
    differ = np.abs(source - target)
    affinity = np.where(differ < 5.0, np.exp(-(differ**2) / (2 * (5.0 / 3) ** 2)), 0.0)
    figure = new_figure(3.1)
    left, middle, right = figure.subplots(1, 3, width_ratios=(1, 1, 1.35))
    count = int(problem.inlier_mask.sum())
    rng = np.random.default_rng(0)
    mixed = rng.permutation(len(problem))
    left.imshow(affinity[np.ix_(mixed, mixed)], cmap="Greys", vmin=0, vmax=1.3, interpolation="nearest")
    left.set(xticks=[], yticks=[])
    left.spines[:].set_visible(False)
    left.set_title("Affinities as they come", loc="left", fontsize=FONT + 0.5, color=TEXT, pad=9)
    show_matrix(middle, affinity, count, "The same, correct matches first")
    order = np.argsort(-u, kind="stable")
    right.bar(np.arange(1, len(u) + 1), u[order], color=colors_of(problem.inlier_mask[order]), width=0.8)
    cut = result.size + 0.5
    right.axvline(cut, color=TEXT, linewidth=1.1, linestyle=(0, (4, 2)))
    right.text(
        cut + 3.5,
        float(u.max()) * 0.93,
        f"$u^T M u$ = {result.diagnostics['objective']:.1f}:\n{result.size} are the group",
        fontsize=FONT - 0.5,
        color=TEXT,
        va="top",
    )
    finish(right, title="Entries of u, greatest first", xlabel="match", ylabel="$u_i$")
    name_right_and_wrong(figure)
    return figure
