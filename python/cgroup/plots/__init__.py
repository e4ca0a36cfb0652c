"""Figures of matplotlib (extra ``cgroup[scans]``), to be saved by `Figure.savefig`."""

from cgroup.plots.matches import comparison_figure, keypoints_figure, registration_figure

__all__ = ["comparison_figure", "keypoints_figure", "registration_figure"]
