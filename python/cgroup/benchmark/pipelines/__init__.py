"""Ways to register two clouds, from the points to the pose: cgroup's and those of other libraries."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cgroup.benchmark.pipelines import libraries, own
from cgroup.benchmark.pipelines.answer import Answer, Clouds

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["PIPELINES", "Answer", "Clouds"]


class PipelineInfo(NamedTuple):
    """A built-in pipeline: its function, the module that it needs if any, and a title for people."""

    run: Callable[..., Answer]
    needs: str
    title: str


PIPELINES = {
    "cgroup": PipelineInfo(own.dense, "", "register: dense front end, grouping, verification, refinement"),
    "cgroup-paper": PipelineInfo(own.paper, "", "register with the paper's front end"),
    "cgroup-matches": PipelineInfo(own.matches, "", "dense front end and grouping alone"),
    "open3d-ransac": PipelineInfo(libraries.open3d_ransac, "open3d", "Open3D: FPFH and RANSAC"),
    "open3d-fgr": PipelineInfo(libraries.open3d_fgr, "open3d", "Open3D: FPFH and fast global registration"),
    "kiss-matcher": PipelineInfo(libraries.kiss_matcher, "kiss_matcher", "KISS-Matcher"),
}
"""Built-in pipelines."""
