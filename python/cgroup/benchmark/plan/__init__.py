"""Which cases and pairs a configuration asks for."""

from cgroup.benchmark.plan.datasets import DatasetFacts
from cgroup.benchmark.plan.experiments import PlannedExperiment
from cgroup.benchmark.plan.registration import PlannedSet
from cgroup.benchmark.plan.whole import Plan, make_plan

__all__ = ["DatasetFacts", "Plan", "PlannedExperiment", "PlannedSet", "make_plan"]
