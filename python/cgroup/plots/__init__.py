"""Figures, one function each. They are returned, never shown: save them with `Figure.savefig`."""

from cgroup.plots.keypoints import keypoints_figure
from cgroup.plots.matches import comparison_figure, registration_figure
from cgroup.plots.scores import precision_recall_figure

__all__ = ["comparison_figure", "keypoints_figure", "precision_recall_figure", "registration_figure"]
