"""Which cases, pairs and problems a configuration asks for."""

from cgroup.benchmark.plan.datasets import DatasetFacts
from cgroup.benchmark.plan.experiments import PlannedExperiment
from cgroup.benchmark.plan.registration import PlannedSet
from cgroup.benchmark.plan.trials import PlannedTrials
from cgroup.benchmark.plan.whole import Plan, make_plan

__all__ = ["DatasetFacts", "Plan", "PlannedExperiment", "PlannedSet", "PlannedTrials", "make_plan"]
