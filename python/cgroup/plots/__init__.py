"""Figures of matplotlib (extra ``cgroup[scans]``); save them with `Figure.savefig`."""

from cgroup.plots.matches import comparison_figure, keypoints_figure, registration_figure

__all__ = ["comparison_figure", "keypoints_figure", "registration_figure"]
