"""Problems and solvers of a configuration."""

import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from cgroup.benchmark import entries
from cgroup.benchmark.config import Config
from cgroup.benchmark.problem import AND, READY_MADE, Kind, Problem, Task, keyed_rng
from cgroup.benchmark.solver import Solver
from cgroup.datasets import Dataset, mixed_names, open_dataset
from cgroup.datasets.generated_matches import GeneratedMatches
from cgroup.datasets.scan_sets import find_scan_set
from cgroup.errors import InputError
from cgroup.evaluation.protocols import PROTOCOLS
from cgroup.registry import PRESETS

Item = TypeVar("Item")

_ASKING_FOR_CLOUDS: dict[Task, tuple[set[str], str]] = {
    "experiment": ({"nuisance", "sweep", "front"}, "it takes no nuisance, sweep or front"),
    "registration": ({"id"}, "registration needs clouds"),
    "matches": ({"matches", "mirrored", "mixed"}, "leave out matches, mirrored and mixed"),
}
"""Keys by which a set asks for clouds, and the error text for data sets of correspondences."""


@dataclass(frozen=True)
class DatasetFacts:
    """Facts about a data set, and origin and protocols of each pair in use."""

    name: str
    title: str
    role: str
    origin: str
    citation: str
    pairs: dict[str, tuple[str, tuple[str, ...]]]


@dataclass(frozen=True)
class PlannedSet:
    """A set of problems in the order of the work, and its solvers, each run on all problems.

    Each solver is run with each number of `threads`; 0 means all cores. Groups are scored at `epsilons`.
    A solver is stopped after `limit` seconds.
    """

    entry: entries.SetEntry | entries.TimingEntry
    problems: tuple[Problem, ...]
    solvers: tuple[Solver, ...]
    threads: tuple[int, ...]
    epsilons: tuple[float, ...]
    limit: float


@dataclass(frozen=True)
class Plan:
    """All sets of a configuration, their data sets, and the reasons why data or libraries are missing."""

    config: Config
    sets: tuple[PlannedSet, ...]
    datasets: tuple[DatasetFacts, ...]
    missing: dict[str, str]


def make_plan(config: Config, root: Path | None) -> Plan:
    """List the problems of a configuration without reading clouds.

    Missing data sets and pipelines are left out and named in `missing`. Raises `InputError` if all data sets
    are missing, a named pair doesn't exist, or a set doesn't fit its data.
    """
    opened = _OpenDatasets(root)
    planned = list(_plan_sets(config, opened))
    missing = dict(opened.missing)
    if not opened.found and not any(each.problems for each in planned):
        name, why = next(iter(missing.items()))
        raise InputError("data", remedy=f"all data sets are missing; {name}: {why}")
    facts = tuple(_describe(name, found, planned) for name, found in opened.found.items())
    if config.timing is not None:
        planned.append(_plan_timing(config, config.timing, opened))
    return Plan(config, tuple(planned), facts, missing)


class _OpenDatasets:
    """Data sets opened once with their pairs, and the reasons why others or pipelines are missing."""

    def __init__(self, root: Path | None) -> None:
        self._root = root
        self.found: dict[str, Dataset] = {}
        self.pairs: dict[str, list[str]] = {}
        self.missing: dict[str, str] = {}

    def open(self, name: str) -> bool:
        """Open a data set once; return whether it exists."""
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

    def find_scans(self, names: Sequence[str]) -> bool:
        """Return whether the scans of all places exist."""
        for name in names:
            try:
                find_scan_set(name, self._root)
            except InputError as error:  # noqa: PERF203 - a few at most
                self.missing[name] = str(error)
        return not self.missing.keys() & set(names)

    def draw_pairs(self, entry: entries.PairsEntry, name: str, seed: int) -> list[str]:
        """Return the complete pairs of a data set, in its order unless names are given.

        A smaller draw is part of every larger one.
        """
        pairs, wanted = self.pairs[name], entry.pairs
        if wanted is None:
            return pairs
        if isinstance(wanted, int):
            return _draw("pairs", wanted, pairs, seed, name)
        known = {*pairs, *self.found[name].lacking_pairs()}
        unknown = [pair for pair in wanted if pair not in known]
        if unknown:
            raise InputError(f"{entry.id}: {name} has no pair {unknown[0]!r}; the first is {pairs[0]!r}")
        return [pair for pair in wanted if pair in pairs]


def _plan_sets(config: Config, opened: _OpenDatasets) -> Iterator[PlannedSet]:
    """Plan all sets except the timing; pipelines whose libraries are missing are left out."""

    def installed(listed: Iterable[entries.MethodEntry]) -> tuple[Solver, ...]:
        reasons = {each: each.why_missing() for each in (entry.solver() for entry in listed)}
        opened.missing |= {each.label: why for each, why in reasons.items() if why}
        return tuple(each for each, why in reasons.items() if not why)

    def problems(entry: entries.PairsEntry) -> tuple[Problem, ...]:
        names = [name for name in entry.dataset or (GeneratedMatches.name,) if opened.open(name)]
        found = (each for name in names for each in _list_problems(entry, name, opened, config.seed))
        return tuple(dict.fromkeys(found))

    for entry in config.experiment:
        methods = installed(entry.methods or config.methods)
        yield PlannedSet(entry, problems(entry), methods, (1,), entry.epsilons, entry.limit)
    if (registration := config.registration) is not None:
        for entry in registration.sets:
            used = (each for each in registration.pipelines if each.solver().label not in entry.without)
            threads, limit = (registration.threads,), registration.limit
            yield PlannedSet(entry, problems(entry), installed(used), threads, (), limit)
    if (scenes := config.scenes) is not None:
        solvers = installed(scenes.solvers)
        for entry in scenes.sets:
            seeds = dict.fromkeys(entry.seeds or (config.seed,)) if opened.find_scans(entry.dataset) else ()
            kind, places = "mirrored" if entry.mirrored else "related", AND.join(entry.dataset)
            bags = tuple(Problem("scenes", places, f"seed {seed}", kind, seed=seed) for seed in seeds)
            yield PlannedSet(entry, bags, solvers, (scenes.threads,), (), scenes.limit)
    if (trials := config.trials) is not None:
        for entry in trials.sets:
            methods = installed(entry.methods or trials.methods or config.methods)
            methods = tuple(_with_preset(each, entry.preset) for each in methods)
            yield PlannedSet(entry, problems(entry), methods, trials.threads, (entry.epsilon,), trials.limit)


def _with_preset(method: Solver, preset: str) -> Solver:
    """Return the method with the options of a preset, unless it has its own."""
    options = PRESETS[preset].get(method.name, {})
    return replace(method, options=json.dumps({**options, **json.loads(method.options)}, sort_keys=True))


def _list_problems(
    entry: entries.PairsEntry, name: str, opened: _OpenDatasets, seed: int
) -> Iterator[Problem]:
    if isinstance(entry, entries.TrialSetEntry) and entry.grid is not None:
        for recipe in entry.grid.recipes():
            kind = "related" if recipe.inliers else "mixed"
            yield Problem("matches", name, recipe.name, kind, seed=seed)
        return
    ready_made = opened.found[name].role == "correspondences"
    _check_role(entry, name, ready_made=ready_made)
    pairs = opened.draw_pairs(entry, name, seed)
    if isinstance(entry, entries.ExperimentEntry):
        combinations = (READY_MADE,) if ready_made else entry.combinations
        for pair, level, combination in itertools.product(pairs, entry.levels or (None,), combinations):
            problem = Problem("experiment", name, pair, matches=combination, seed=seed)
            if entry.sweep:
                problem = replace(problem, nms_radius=level)
            else:
                problem = replace(problem, nuisance=entry.nuisance, level=level)
            yield replace(problem, front=entry.front.changes(problem.detector, problem.nuisance))
        return
    assert isinstance(entry, entries.UnrelatedSetEntry)  # noqa: S101 - no other class is left
    mixed = mixed_names(opened.found[name]) if entry.mixed else []
    among = [both for both in mixed if set(both) <= set(pairs)]
    kinds: list[tuple[str, Kind, str]] = [
        *((pair, "related", "") for pair in pairs),
        *((pair, "mirrored", "") for pair in _draw("mirrored", entry.mirrored, pairs, seed, name)),
        *((pair, "mixed", other) for pair, other in _draw("mixed", entry.mixed, among, seed, name)),
    ]
    matches = entry.matches if isinstance(entry, entries.TrialSetEntry) else READY_MADE
    for pair, kind, other in kinds:
        yield Problem(entry.task, name, pair, kind, other, matches=matches, voxel=entry.voxel, seed=seed)


def _check_role(entry: entries.PairsEntry, name: str, *, ready_made: bool) -> None:
    """Raise if a set needs clouds and its data set has matches, or vice versa."""
    asking, refusal = _ASKING_FOR_CLOUDS[entry.task]
    message = ""
    if ready_made and entry.model_dump(include=asking, exclude_defaults=True):
        message = f"{entry.id}: {name} consists of correspondences; {refusal}"
    elif not ready_made and isinstance(entry, entries.TrialSetEntry) and not entry.matches:
        message = f"{entry.id}: {name} has clouds; give matches, the way to match them"
    if message:
        raise InputError(message)


def _plan_timing(config: Config, timing: entries.TimingEntry, opened: _OpenDatasets) -> PlannedSet:
    """Plan the timing on the first data set that exists."""
    name = next(filter(opened.open, timing.dataset), None)
    if name is None:
        reasons = "; ".join(f"{name}: {opened.missing[name]}" for name in timing.dataset)
        raise InputError(f"timing: all data sets are missing; {reasons}")
    if opened.found[name].role == "correspondences":
        raise InputError(f"timing: {name} consists of correspondences; sets of several sizes need clouds")
    pair = timing.pair if timing.pair is not None else opened.pairs[name][0]
    problems = tuple(
        Problem("timing", name, pair, size=size, repeats=timing.repeats, seed=config.seed)
        for size in sorted(set(timing.sizes))
    )
    solvers = tuple(each.solver() for each in timing.methods or config.methods)
    return PlannedSet(timing, problems, solvers, timing.threads, (), timing.budget)


def _draw(purpose: str, count: int, items: Sequence[Item], seed: int, name: str) -> list[Item]:
    """Return a random choice of a data set's items in their order; all if there are fewer."""
    order = keyed_rng(purpose, seed, name).permutation(len(items))
    return [items[i] for i in sorted(order[:count])]


def _describe(name: str, dataset: Dataset, planned: Iterable[PlannedSet]) -> DatasetFacts:
    used = {problem.pair for each in planned for problem in each.problems if problem.dataset == name}
    pairs = {pair: (dataset.origin_of(pair), dataset.protocols_of(pair)) for pair in sorted(used)}
    for unknown in (each for _, names in pairs.values() for each in names if each not in PROTOCOLS):
        raise InputError(f"{dataset.name}: unknown protocol {unknown!r}; choose from {', '.join(PROTOCOLS)}")
    return DatasetFacts(name, dataset.title, dataset.role, dataset.origin, dataset.citation, pairs)
