"""All that a configuration asks for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from cgroup.benchmark.plan.datasets import OpenDatasets, describe_dataset
from cgroup.benchmark.plan.experiments import plan_experiment
from cgroup.benchmark.plan.registration import plan_sets
from cgroup.benchmark.plan.trials import plan_trials
from cgroup.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from cgroup.benchmark.config import Config
    from cgroup.benchmark.plan.datasets import DatasetFacts
    from cgroup.benchmark.plan.experiments import PlannedExperiment
    from cgroup.benchmark.plan.registration import PlannedSet
    from cgroup.benchmark.plan.trials import PlannedTrials


@dataclass(frozen=True)
class Plan:
    """All experiments, sets of pairs and sets of problems of a configuration, and the data sets they use."""

    config: Config
    experiments: tuple[PlannedExperiment, ...]
    sets: tuple[PlannedSet, ...]
    trials: tuple[PlannedTrials, ...]
    datasets: tuple[DatasetFacts, ...]

    @property
    def missing(self) -> dict[str, str]:
        """Data sets and pipelines that are not at hand, and why."""
        planned = (*self.experiments, *self.sets, *self.trials)
        return {name: why for each in planned for name, why in each.missing.items()}


def make_plan(config: Config, root: Path | None) -> Plan:
    """Find the pairs that a configuration asks for; no cloud is read.

    Parameters
    ----------
    config : Config
        What to run.
    root : path, optional
        Folder with the data; the environment says by default.

    Returns
    -------
    Plan
        A data set or pipeline that isn't at hand is left out, and named in `missing`.

    Raises
    ------
    InputError
        If none is at hand, or a pair is named that doesn't exist.
    """
    opened = OpenDatasets(root)
    planned = tuple(plan_experiment(config, experiment, opened) for experiment in config.experiment)
    sets = tuple(plan_sets(config, opened))
    trials = tuple(plan_trials(config, opened))
    cases = [case for each in (*planned, *sets, *trials) for case in each.cases]
    datasets = tuple(
        describe_dataset(name, found, {case.pair for case in cases if case.dataset == name})
        for name, found in opened.found.items()
    )
    plan = Plan(config, planned, sets, trials, datasets)
    if not opened.found:
        name, why = next(iter(plan.missing.items()))
        message = f"data: none of the data sets is at hand; {name}: {why}"
        raise InputError(message)
    return plan
