"""SS and NNSR: one number per match, and a cut."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import cgroup
from cgroup import features
from cgroup.datasets import standin_pair
from cgroup.evaluation import correct_matches
from cgroup.plots.style import CORRECT, QUIET_TEXT, TEXT, WRONG
from cgroup.registration import describe
from method_figures.drawing import (
    ACCENT,
    FONT,
    draw_histogram,
    finish,
    mark_cut,
    name_right_and_wrong,
    new_figure,
)
from method_figures.sweeps import VIEWS, problems

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from cgroup.types import BoolArray, FloatArray

_VIEW = 1  # of the problems on views


def ss() -> Figure:
    """Draw similarities of correct and wrong matches with Otsu's threshold."""
    matches, correct = problems(VIEWS)[_VIEW]
    similarity = np.asarray(matches.similarity)
    cut = cgroup.ss(similarity).threshold or 0.0
    figure = new_figure(2.7)
    left, right = figure.subplots(1, 2)
    draw_histogram(left, similarity, correct, bins=np.linspace(similarity.min(), similarity.max(), 31))
    mark_cut(left, cut, "Otsu's cut")
    finish(left, title="How alike the two descriptors are", xlabel="similarity", ylabel="matches")
    cuts = np.linspace(similarity.min(), similarity.max(), 101)[1:-1]
    right.plot(cuts, [_between_classes(similarity, each) for each in cuts], color=ACCENT, linewidth=1.6)
    mark_cut(right, cut, "greatest here")
    finish(
        right,
        title="Otsu: how far apart the two classes lie",
        xlabel="cut",
        ylabel="variance between classes",
    )
    right.set_ylim(0, right.get_ylim()[1] * 1.15)
    name_right_and_wrong(figure, dots=False)
    return figure


def _between_classes(scores: FloatArray, cut: float) -> float:
    above = scores > cut
    share = above.mean()
    if share in (0, 1):
        return 0.0
    return float(share * (1 - share) * (scores[above].mean() - scores[~above].mean()) ** 2)


def nnsr() -> Figure:
    """Draw nearest and second-nearest distances, with Lowe's threshold."""
    first, second, correct = _descriptor_distances()
    ratio = first / second
    figure = new_figure(2.9)
    left, right = figure.subplots(1, 2)
    for chosen, color, size in ((~correct, WRONG, 7), (correct, CORRECT, 15)):
        left.scatter(second[chosen], first[chosen], s=size, color=color, alpha=0.75, linewidths=0)
    reach = np.array([0.0, second.max() * 1.03])
    left.fill_between(reach, 0, 0.8 * reach, color=ACCENT, alpha=0.10, linewidth=0)
    left.plot(reach, 0.8 * reach, color=TEXT, linewidth=1.1, linestyle=(0, (4, 2)))
    left.plot(reach, reach, color=QUIET_TEXT, linewidth=0.8)
    left.text(0.93, 0.3, "kept", transform=left.transAxes, ha="right", fontsize=FONT, color=ACCENT)
    left.set(xlim=(0.2, reach[1]), ylim=(0.1, reach[1]))
    finish(
        left,
        title="Distances to the two nearest descriptors",
        xlabel="second nearest $d_2$",
        ylabel="nearest $d_1$",
    )
    draw_histogram(right, ratio, correct, bins=np.linspace(ratio.min(), 1, 29))
    mark_cut(right, 0.8, "max_ratio = 0.8", left=True)
    finish(right, title="Their ratio: kept to the left of the line", xlabel="$d_1 / d_2$", ylabel="matches")
    name_right_and_wrong(figure)
    return figure


def _descriptor_distances() -> tuple[FloatArray, FloatArray, BoolArray]:
    """Match SHOT descriptors of one pair; return both distances, and a mask of the correct matches."""
    pair = standin_pair(seed=_VIEW)
    resolution = float(np.mean([features.resolution(side.points) for side in (pair.source, pair.target)]))
    source, target = (describe(side, resolution=resolution) for side in (pair.source, pair.target))
    matches = features.match(source.descriptors, target.descriptors)
    correct = correct_matches(
        source.points[matches.source_indices],
        target.points[matches.target_indices],
        pair.T_target_source,
        tolerance=5 * resolution,
    )
    return matches.distance, matches.second_distance, correct
