"""Which cases each experiment asks for."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cgroup.benchmark.cases import READY_MADE, Case
from cgroup.benchmark.config import FrontEntry
from cgroup.benchmark.plan.datasets import draw_pairs
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.config import Config, ExperimentEntry
    from cgroup.benchmark.plan.datasets import OpenDatasets


@dataclass(frozen=True)
class PlannedExperiment:
    """An experiment and what it needs.

    Attributes
    ----------
    experiment : ExperimentEntry
        As configured.
    cases : tuple of Case
        To be run.
    methods : tuple of Candidate
        To be run on each.
    missing : dict of str to str
        Data sets that are not at hand, or not whole, and why.
    """

    experiment: ExperimentEntry
    cases: tuple[Case, ...]
    methods: tuple[Candidate, ...]
    missing: dict[str, str]


def plan_experiment(config: Config, experiment: ExperimentEntry, opened: OpenDatasets) -> PlannedExperiment:
    """Find the cases of an experiment."""
    at_hand = [name for name in experiment.dataset if opened.open(name)]
    missing = {name: opened.missing[name] for name in experiment.dataset if name in opened.missing}
    cases = tuple(case for name in at_hand for case in _list_cases(config.seed, experiment, name, opened))
    entries = experiment.methods or config.methods
    return PlannedExperiment(experiment, cases, tuple(entry.candidate() for entry in entries), missing)


def _list_cases(seed: int, experiment: ExperimentEntry, name: str, opened: OpenDatasets) -> Iterator[Case]:
    levels: Sequence[float | None] = experiment.levels or (None,)
    combinations = experiment.combinations
    if opened.found[name].role == "correspondences":
        if experiment.nuisance or experiment.sweep or experiment.front != FrontEntry():
            message = (
                f"{experiment.id}: {name} comes as correspondences; it takes no nuisance, sweep or front"
            )
            raise InputError(message)
        combinations = (READY_MADE,)
    for pair in draw_pairs(experiment.id, experiment.pairs, name, opened, seed):
        for level in levels:
            for combination in combinations:
                if experiment.sweep:
                    case = Case(name, pair, combination=combination, nms_radius=level, seed=seed)
                else:
                    case = Case(name, pair, experiment.nuisance, level, combination, seed=seed)
                yield replace(case, front=experiment.front.changes(case.detector, case.nuisance))
