"""Figures, one function each. Functions return figures and show none: save them with `Figure.savefig`.

They need matplotlib, which comes with the extra ``cgroup[scans]``.
"""

from cgroup.plots.matches import comparison_figure, keypoints_figure, matches_figure, registration_figure
from cgroup.plots.scores import precision_recall_figure

__all__ = [
    "comparison_figure",
    "keypoints_figure",
    "matches_figure",
    "precision_recall_figure",
    "registration_figure",
]
