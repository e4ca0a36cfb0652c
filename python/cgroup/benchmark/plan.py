"""Problems and solvers that a configuration asks for."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

from cgroup.benchmark.config import ExperimentEntry, FrontEntry, PairSetEntry, TrialSetEntry
from cgroup.benchmark.problem import READY_MADE, Problem, keyed_rng
from cgroup.datasets import mixed_names, open_dataset
from cgroup.datasets.generated_matches import GeneratedMatches
from cgroup.errors import InputError
from cgroup.evaluation.protocols import PROTOCOLS
from cgroup.registry import PRESETS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from cgroup.benchmark.config import Config, SetEntry, TimingEntry
    from cgroup.benchmark.solver import Solver
    from cgroup.datasets import Dataset

Item = TypeVar("Item")


@dataclass(frozen=True)
class DatasetFacts:
    """Facts about a data set; of each pair in use, its origin and the protocols that make sense."""

    name: str
    title: str
    role: str
    origin: str
    citation: str
    pairs: dict[str, tuple[str, tuple[str, ...]]]


@dataclass(frozen=True)
class PlannedSet:
    """A set of problems, in the order of the work, and its solvers, each run on all of them.

    `threads` are for each, 0 for all cores; at `epsilons` groups of an experiment are scored; `limit` are
    seconds after which a solver is given up; `missing` says which data sets and pipelines are not at hand.
    """

    entry: SetEntry | TimingEntry
    task: str
    problems: tuple[Problem, ...]
    solvers: tuple[Solver, ...]
    threads: tuple[int, ...] = (1,)
    epsilons: tuple[float, ...] = ()
    limit: float | None = None
    missing: dict[str, str] | None = None


@dataclass(frozen=True)
class Plan:
    """All sets of a configuration, and the data sets that they use."""

    config: Config
    sets: tuple[PlannedSet, ...]
    datasets: tuple[DatasetFacts, ...]

    @property
    def missing(self) -> dict[str, str]:
        """Data sets and pipelines that are not at hand, and why."""
        return {name: why for each in self.sets for name, why in (each.missing or {}).items()}


def make_plan(config: Config, root: Path | None) -> Plan:
    """Find the pairs that a configuration asks for below a folder with the data; no cloud is read.

    A data set or pipeline that isn't at hand is left out, and named in `missing`.

    Raises
    ------
    InputError
        If none is at hand, a pair is named that doesn't exist, or a set doesn't fit its data.
    """
    opened = _OpenDatasets(root)
    planned = [_plan_set(config, entry, opened) for entry in config.sets]
    missing = {name: why for each in planned for name, why in (each.missing or {}).items()}
    if not opened.found:
        name, why = next(iter(missing.items()))
        remedy = f"none of the data sets is at hand; {name}: {why}"
        raise InputError("data", remedy=remedy)
    facts = tuple(_describe(name, found, planned) for name, found in opened.found.items())
    if config.timing is not None:
        planned.append(_plan_timing(config, config.timing, opened))
    return Plan(config, tuple(planned), facts)


class _OpenDatasets:
    """Data sets opened once: those at hand with their pairs, and reasons why others aren't."""

    def __init__(self, root: Path | None) -> None:
        self._root = root
        self.found: dict[str, Dataset] = {}
        self.pairs: dict[str, list[str]] = {}
        self.missing: dict[str, str] = {}

    def open(self, name: str) -> bool:
        """Open a data set unless that has been tried; return whether it is at hand."""
        if name not in self.found and name not in self.missing:
            try:
                dataset = open_dataset(name, self._root)
                self.pairs[name] = dataset.pair_names()
                if note := dataset.note():
                    self.missing[name] = note
                self.found[name] = dataset
            except InputError as error:
                self.missing[name] = str(error)
        return name in self.found

    def draw_pairs(self, entry: SetEntry, name: str, seed: int) -> list[str]:
        """Choose pairs of a data set, in its order unless they are named; without those that lack files.

        A smaller draw is part of every larger one, so that problems are shared.
        """
        pairs, wanted = self.pairs[name], entry.pairs
        if wanted is None:
            return pairs
        if isinstance(wanted, int):
            return _draw("pairs", wanted, pairs, seed, name)
        known = {*pairs, *self.found[name].lacking_pairs()}
        unknown = [pair for pair in wanted if pair not in known]
        if unknown:
            message = f"{entry.id}: {name} has no pair {unknown[0]!r}; the first is {pairs[0]!r}"
            raise InputError(message)
        return [pair for pair in wanted if pair in pairs]


def _plan_set(config: Config, entry: SetEntry, opened: _OpenDatasets) -> PlannedSet:
    names = entry.dataset or (GeneratedMatches.name,)
    at_hand = [name for name in names if opened.open(name)]
    missing = {name: opened.missing[name] for name in names if name in opened.missing}
    solvers, rest = _find_solvers(config, entry, missing)
    problems = dict.fromkeys(
        problem for name in at_hand for problem in _list_problems(entry, name, opened, config.seed)
    )
    return PlannedSet(entry, entry.task, tuple(problems), solvers, missing=missing, **rest)


def _find_solvers(
    config: Config, entry: SetEntry, missing: dict[str, str]
) -> tuple[tuple[Solver, ...], dict[str, Any]]:
    """Find the solvers of a set, and how they are run; those that aren't installed become missing."""
    if isinstance(entry, ExperimentEntry):
        methods = entry.methods or config.methods
        return tuple(each.solver() for each in methods), {"epsilons": entry.epsilons}
    if isinstance(entry, TrialSetEntry):
        trials = config.trials
        assert trials is not None  # noqa: S101 - the set is one of them
        methods = entry.methods or trials.methods or config.methods
        solvers = tuple(_with_preset(each.solver(), entry.preset) for each in methods)
        return solvers, {"threads": trials.threads, "limit": trials.limit}
    registration = config.registration
    assert registration is not None  # noqa: S101 - the set is one of them
    assert isinstance(entry, PairSetEntry)  # noqa: S101
    wanted = [each.solver() for each in registration.pipelines]
    reasons = {each: each.why_missing() for each in wanted if each.label not in entry.without}
    missing |= {each.label: why for each, why in reasons.items() if why}
    return tuple(each for each, why in reasons.items() if not why), {"threads": (registration.threads,)}


def _with_preset(method: Solver, preset: str) -> Solver:
    """Add the options of a preset to those that the method has."""
    options = PRESETS[preset].get(method.name, {})
    return replace(method, options=json.dumps({**options, **json.loads(method.options)}, sort_keys=True))


def _list_problems(entry: SetEntry, name: str, opened: _OpenDatasets, seed: int) -> Iterator[Problem]:
    ready_made = opened.found[name].role == "correspondences"
    if isinstance(entry, TrialSetEntry) and entry.grid is not None:
        for recipe in entry.grid.recipes():
            kind = "related" if recipe.inliers else "mixed"
            yield Problem("matches", name, recipe.name, kind, epsilon=entry.epsilon, seed=seed)
        return
    _check_role(entry, name, ready_made=ready_made)
    pairs = opened.draw_pairs(entry, name, seed)
    if isinstance(entry, ExperimentEntry):
        for pair in pairs:
            yield from _list_cases(entry, Problem("experiment", name, pair, seed=seed), ready_made=ready_made)
        return
    assert isinstance(entry, (PairSetEntry, TrialSetEntry))  # noqa: S101 - there is no other
    rest: dict[str, Any] = {"voxel": entry.voxel, "seed": seed}
    if isinstance(entry, TrialSetEntry):
        rest |= {"matches": READY_MADE if ready_made else entry.matches, "epsilon": entry.epsilon}
    for pair in pairs:
        yield Problem(entry.task, name, pair, **rest)
    for pair in _draw("mirrored", entry.mirrored, pairs, seed, name):
        yield Problem(entry.task, name, pair, "mirrored", **rest)
    mixed = (
        [both for both in mixed_names(opened.found[name]) if set(both) <= set(pairs)] if entry.mixed else []
    )
    for pair, other in _draw("mixed", entry.mixed, mixed, seed, name):
        yield Problem(entry.task, name, pair, "mixed", other, **rest)


def _check_role(entry: SetEntry, name: str, *, ready_made: bool) -> None:
    """Refuse a set that asks for clouds where there are matches, or the other way round."""
    problem = ""
    if isinstance(entry, ExperimentEntry):
        if ready_made and (entry.nuisance or entry.sweep or entry.front != FrontEntry()):
            problem = "comes as correspondences; it takes no nuisance, sweep or front"
    elif isinstance(entry, PairSetEntry):
        if ready_made:
            problem = "comes as correspondences; registering needs clouds"
    elif isinstance(entry, TrialSetEntry):
        if ready_made and (entry.matches or entry.mirrored or entry.mixed):
            problem = "comes as correspondences; leave out matches, mirrored and mixed"
        elif not ready_made and not entry.matches:
            problem = "has clouds; matches says how they are matched"
    if problem:
        message = f"{entry.id}: {name} {problem}"
        raise InputError(message)


def _list_cases(entry: ExperimentEntry, pair: Problem, *, ready_made: bool) -> Iterator[Problem]:
    """List a pair at every level and combination."""
    levels: Sequence[float | None] = entry.levels or (None,)
    for level in levels:
        for combination in (READY_MADE,) if ready_made else entry.combinations:
            if entry.sweep:
                problem = replace(pair, matches=combination, nms_radius=level)
            else:
                problem = replace(pair, matches=combination, nuisance=entry.nuisance, level=level)
            yield replace(problem, front=entry.front.changes(problem.detector, problem.nuisance))


def _plan_timing(config: Config, timing: TimingEntry, opened: _OpenDatasets) -> PlannedSet:
    """Plan the timing on the first data set that is at hand."""
    name = next((name for name in timing.dataset if opened.open(name)), None)
    if name is None:
        reasons = "; ".join(f"{name}: {opened.missing[name]}" for name in timing.dataset)
        message = f"timing: none of the data sets is at hand; {reasons}"
        raise InputError(message)
    if opened.found[name].role == "correspondences":
        message = f"timing: {name} comes as correspondences; sets of several sizes need clouds"
        raise InputError(message)
    pair = timing.pair if timing.pair is not None else opened.pairs[name][0]
    problems = tuple(
        Problem("timing", name, pair, size=size, seed=config.seed) for size in sorted(set(timing.sizes))
    )
    methods = timing.methods or config.methods
    solvers = tuple(each.solver() for each in methods)
    return PlannedSet(timing, "timing", problems, solvers, timing.threads)


def _draw(purpose: str, count: int, items: Sequence[Item], seed: int, name: str) -> list[Item]:
    """Draw some of a data set's items without replacement, in their order; all if there are fewer."""
    order = keyed_rng(purpose, seed, name).permutation(len(items))
    return [items[i] for i in sorted(order[:count])]


def _describe(name: str, dataset: Dataset, planned: Iterable[PlannedSet]) -> DatasetFacts:
    """Collect the facts about a data set and its pairs in use."""
    used = {problem.pair for each in planned for problem in each.problems if problem.dataset == name}
    pairs = {pair: (dataset.origin_of(pair), _check_protocols(dataset, pair)) for pair in sorted(used)}
    return DatasetFacts(name, dataset.title, dataset.role, dataset.origin, dataset.citation, pairs)


def _check_protocols(dataset: Dataset, pair: str) -> tuple[str, ...]:
    names = dataset.protocols_of(pair)
    unknown = [name for name in names if name not in PROTOCOLS]
    if unknown:
        message = f"{dataset.name}: there is no protocol {unknown[0]!r}; there are {', '.join(PROTOCOLS)}"
        raise InputError(message)
    return names
