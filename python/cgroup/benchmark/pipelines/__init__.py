"""Pipelines that register two clouds or many scans: cgroup's and those of other libraries."""

from collections.abc import Callable
from typing import Any, NamedTuple

from cgroup.benchmark.pipelines import libraries, own, scene_solvers
from cgroup.benchmark.pipelines.answer import Answer, Clouds, Scans, SceneAnswer

__all__ = ["PIPELINES", "SCENE_SOLVERS", "Answer", "Clouds", "Scans", "SceneAnswer"]


class PipelineInfo(NamedTuple):
    """A built-in pipeline or solver: its function, and the modules that it needs."""

    run: Callable[..., Any]
    needs: str


PIPELINES = {
    "cgroup": PipelineInfo(own.dense, ""),
    "cgroup-paper": PipelineInfo(own.paper, ""),
    "cgroup-matches": PipelineInfo(own.matches, ""),
    "open3d-ransac": PipelineInfo(libraries.open3d_ransac, "open3d"),
    "open3d-fgr": PipelineInfo(libraries.open3d_fgr, "open3d"),
    "kiss-matcher": PipelineInfo(libraries.kiss_matcher, "kiss_matcher"),
}
"""Built-in pipelines."""

SCENE_SOLVERS = {
    "register-all": PipelineInfo(scene_solvers.own, ""),
    "open3d-multiway": PipelineInfo(scene_solvers.open3d_multiway, "open3d"),
    "kiss-matcher-gnc": PipelineInfo(scene_solvers.kiss_matcher_gnc, "kiss_matcher gtsam"),
}
"""Built-in solvers of many scans."""
