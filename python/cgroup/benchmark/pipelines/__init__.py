"""Pipelines that register two clouds or many scans: cgroup's and those of other libraries."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from cgroup.benchmark.pipelines import libraries, own, scene_solvers
from cgroup.benchmark.pipelines.answer import Answer, Clouds
from cgroup.benchmark.pipelines.scene_solvers import Scans, SceneAnswer

__all__ = ["PIPELINES", "SCENE_SOLVERS", "Answer", "Clouds", "Scans", "SceneAnswer"]


class PipelineInfo(NamedTuple):
    """A built-in pipeline or solver: its function, the modules that it needs, and its title."""

    run: Callable[..., Any]
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

SCENE_SOLVERS = {
    "register-all": PipelineInfo(scene_solvers.own, "", "register_all"),
    "open3d-multiway": PipelineInfo(
        scene_solvers.open3d_multiway, "open3d", "Open3D: FPFH, RANSAC, pose graph with line process"
    ),
    "kiss-matcher-gnc": PipelineInfo(
        scene_solvers.kiss_matcher_gnc, "kiss_matcher gtsam", "KISS-Matcher, pose graph by GTSAM's GNC"
    ),
}
"""Built-in solvers of many scans."""
