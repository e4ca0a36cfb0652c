"""Which cases each experiment asks for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from cgroup.benchmark.cases import READY_MADE, Case, keyed_rng
from cgroup.datasets import open_dataset
from cgroup.errors import InputError
from cgroup.evaluation.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.config import Config, ExperimentEntry
    from cgroup.datasets import Dataset


@dataclass(frozen=True)
class DatasetFacts:
    """What records and figures say about a data set.

    Attributes
    ----------
    name, title, role, origin, citation : str
        As the data set has them; the name is the one that the configuration uses.
    pairs : dict of str to (str, tuple of str)
        Of each pair that is used: its origin, and the registration protocols that make sense for it.
    """

    name: str
    title: str
    role: str
    origin: str
    citation: str
    pairs: dict[str, tuple[str, tuple[str, ...]]]


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
        Data sets that are not at hand, and why.
    """

    experiment: ExperimentEntry
    cases: tuple[Case, ...]
    methods: tuple[Candidate, ...]
    missing: dict[str, str]


@dataclass(frozen=True)
class Plan:
    """All experiments of a configuration, and the data sets that they use."""

    config: Config
    experiments: tuple[PlannedExperiment, ...]
    datasets: tuple[DatasetFacts, ...]

    @property
    def missing(self) -> dict[str, str]:
        """Data sets that are not at hand, and why."""
        return {name: why for planned in self.experiments for name, why in planned.missing.items()}


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
        A data set that isn't at hand is left out, and named in `missing`.

    Raises
    ------
    InputError
        If none is at hand, or a pair is named that doesn't exist.
    """
    opened = _OpenDatasets(root)
    planned = tuple(_plan_experiment(config, experiment, opened) for experiment in config.experiment)
    datasets = tuple(_describe_dataset(name, found, planned) for name, found in opened.found.items())
    plan = Plan(config, planned, datasets)
    if not opened.found:
        name, why = next(iter(plan.missing.items()))
        message = f"data: none of the data sets is at hand; {name}: {why}"
        raise InputError(message)
    return plan


class _OpenDatasets:
    """Data sets, opened once."""

    def __init__(self, root: Path | None) -> None:
        self._root = root
        self.found: dict[str, Dataset] = {}
        self.pairs: dict[str, list[str]] = {}
        self.missing: dict[str, str] = {}

    def open(self, name: str) -> bool:
        if name not in self.found and name not in self.missing:
            try:
                dataset = open_dataset(name, self._root)
                self.pairs[name] = dataset.pair_names()
                self.found[name] = dataset
            except InputError as error:
                self.missing[name] = str(error)
        return name in self.found


def _plan_experiment(config: Config, experiment: ExperimentEntry, opened: _OpenDatasets) -> PlannedExperiment:
    at_hand = [name for name in experiment.dataset if opened.open(name)]
    missing = {name: opened.missing[name] for name in experiment.dataset if name not in at_hand}
    cases = tuple(case for name in at_hand for case in _list_cases(config.seed, experiment, name, opened))
    entries = experiment.methods or config.methods
    return PlannedExperiment(experiment, cases, tuple(entry.candidate() for entry in entries), missing)


def _list_cases(seed: int, experiment: ExperimentEntry, name: str, opened: _OpenDatasets) -> Iterator[Case]:
    levels: Sequence[float | None] = experiment.levels or (None,)
    combinations = experiment.combinations
    if opened.found[name].role == "correspondences":
        if experiment.nuisance or experiment.sweep:
            message = f"{experiment.id}: {name} comes as correspondences; it takes no nuisance and no sweep"
            raise InputError(message)
        combinations = (READY_MADE,)
    for pair in _draw_pairs(seed, experiment, name, opened.pairs[name]):
        for level in levels:
            for combination in combinations:
                if experiment.sweep:
                    yield Case(name, pair, combination=combination, nms_radius=level, seed=seed)
                else:
                    yield Case(name, pair, experiment.nuisance, level, combination, seed=seed)


def _draw_pairs(seed: int, experiment: ExperimentEntry, name: str, pairs: list[str]) -> list[str]:
    """Pairs of one experiment; a smaller draw is part of every larger one, so that cases are shared."""
    wanted = experiment.pairs
    if wanted is None:
        return pairs
    if isinstance(wanted, int):
        order = keyed_rng("pairs", seed, name).permutation(len(pairs))
        return [pairs[i] for i in sorted(order[:wanted])]
    unknown = [pair for pair in wanted if pair not in pairs]
    if unknown:
        message = f"{experiment.id}: {name} has no pair {unknown[0]!r}; the first is {pairs[0]!r}"
        raise InputError(message)
    return list(wanted)


def _describe_dataset(name: str, dataset: Dataset, planned: Sequence[PlannedExperiment]) -> DatasetFacts:
    used = {case.pair for entry in planned for case in entry.cases if case.dataset == name}
    return DatasetFacts(
        name,
        dataset.title,
        dataset.role,
        dataset.origin,
        dataset.citation,
        {pair: (dataset.origin_of(pair), _check_protocols(dataset, pair)) for pair in sorted(used)},
    )


def _check_protocols(dataset: Dataset, pair: str) -> tuple[str, ...]:
    names = dataset.protocols_of(pair)
    unknown = [name for name in names if name not in PROTOCOLS]
    if unknown:
        message = f"{dataset.name}: there is no protocol {unknown[0]!r}; there are {', '.join(PROTOCOLS)}"
        raise InputError(message)
    return names
