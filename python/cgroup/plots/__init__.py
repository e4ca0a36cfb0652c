"""Figures, one function each. Functions return figures and show none: save them with `Figure.savefig`.

They need matplotlib, which comes with the extra ``cgroup[scans]``.
"""

from cgroup.plots.experiments import (
    inliers_figure,
    pair_precision_figure,
    pipelines_figure,
    registration_rate_figure,
    scores_figure,
    timing_figure,
    trials_figure,
)
from cgroup.plots.matches import comparison_figure, keypoints_figure, matches_figure, registration_figure
from cgroup.plots.readings import readings_figure
from cgroup.plots.scores import precision_recall_figure

__all__ = [
    "comparison_figure",
    "inliers_figure",
    "keypoints_figure",
    "matches_figure",
    "pair_precision_figure",
    "pipelines_figure",
    "precision_recall_figure",
    "readings_figure",
    "registration_figure",
    "registration_rate_figure",
    "scores_figure",
    "timing_figure",
    "trials_figure",
]
