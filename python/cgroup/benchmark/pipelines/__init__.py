"""Ways to register two clouds, from the points to the pose: cgroup's and those of other libraries."""

from cgroup.benchmark.pipelines.pipeline import PIPELINES, Pipeline, make_pipeline
from cgroup.benchmark.pipelines.problem import Answer, Problem

__all__ = ["PIPELINES", "Answer", "Pipeline", "Problem", "make_pipeline"]
