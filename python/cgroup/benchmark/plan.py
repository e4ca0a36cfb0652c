"""Problems and solvers that a configuration asks for."""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

from cgroup.benchmark.config import ExperimentEntry, PairsEntry, TrialSetEntry, UnrelatedSetEntry
from cgroup.benchmark.problem import AND, READY_MADE, Problem, keyed_rng
from cgroup.datasets import mixed_names, open_dataset
from cgroup.datasets.generated_matches import GeneratedMatches
from cgroup.datasets.scan_sets import find_scan_set
from cgroup.errors import InputError
from cgroup.evaluation.protocols import PROTOCOLS
from cgroup.registry import PRESETS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

    from cgroup.benchmark.config import Config, MethodEntry, SceneSetEntry, SetEntry, TimingEntry
    from cgroup.benchmark.problem import Kind, Task
    from cgroup.benchmark.solver import Solver
    from cgroup.datasets import Dataset

Item = TypeVar("Item")

_ASKING_FOR_CLOUDS: dict[Task, tuple[set[str], str]] = {
    "experiment": ({"nuisance", "sweep", "front"}, "it takes no nuisance, sweep or front"),
    "registration": ({"id"}, "registering needs clouds"),
    "matches": ({"matches", "mirrored", "mixed"}, "leave out matches, mirrored and mixed"),
}
"""Keys of a set by which it asks for clouds, and what is said where a data set comes as correspondences."""


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
    seconds after which a solver is given up.
    """

    entry: SetEntry | TimingEntry
    task: str
    problems: tuple[Problem, ...]
    solvers: tuple[Solver, ...]
    threads: tuple[int, ...] = (1,)
    epsilons: tuple[float, ...] = ()
    limit: float | None = None


@dataclass(frozen=True)
class Plan:
    """All sets of a configuration, the data sets that they use, and what is not at hand, and why."""

    config: Config
    sets: tuple[PlannedSet, ...]
    datasets: tuple[DatasetFacts, ...]
    missing: dict[str, str]


def make_plan(config: Config, root: Path | None) -> Plan:
    """Find the pairs that a configuration asks for below a folder with the data; no cloud is read.

    A data set or pipeline that isn't at hand is left out, and named in `missing`.

    Raises
    ------
    InputError
        If none is at hand, a pair is named that doesn't exist, or a set doesn't fit its data.
    """
    opened = _OpenDatasets(root)
    planned = list(_plan_sets(config, opened))
    missing = dict(opened.missing)
    if not opened.found and not any(each.problems for each in planned):
        name, why = next(iter(missing.items()))
        remedy = f"none of the data sets is at hand; {name}: {why}"
        raise InputError("data", remedy=remedy)
    facts = tuple(_describe(name, found, planned) for name, found in opened.found.items())
    if config.timing is not None:
        planned.append(_plan_timing(config, config.timing, opened))
    return Plan(config, tuple(planned), facts, missing)


class _OpenDatasets:
    """Data sets opened once: those at hand with their pairs, and reasons why others, or pipelines, aren't."""

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

    def comes_as_matches(self, name: str) -> bool:
        """Whether pairs of a data set are correspondences without clouds."""
        return self.found[name].role == "correspondences"

    def find_scans(self, names: Sequence[str]) -> bool:
        """Return whether the scans of all places are at hand."""
        for name in names:
            try:
                find_scan_set(name, self._root)
            except InputError as error:  # noqa: PERF203 - a few at most
                self.missing[name] = str(error)
        return not self.missing.keys() & set(names)

    def draw_pairs(self, entry: PairsEntry, name: str, seed: int) -> list[str]:
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


def _plan_sets(config: Config, opened: _OpenDatasets) -> Iterator[PlannedSet]:
    """Plan all sets but the timing; pipelines that aren't installed become missing."""

    def at_hand(entries: Iterable[MethodEntry]) -> list[Solver]:
        reasons = {each: each.why_missing() for each in (entry.solver() for entry in entries)}
        opened.missing |= {each.label: why for each, why in reasons.items() if why}
        return [each for each, why in reasons.items() if not why]

    def plan(entry: PairsEntry, solvers: Iterable[Solver], **how: Any) -> PlannedSet:  # noqa: ANN401
        names = [name for name in entry.dataset or (GeneratedMatches.name,) if opened.open(name)]
        problems = (each for name in names for each in _list_problems(entry, name, opened, config.seed))
        return PlannedSet(entry, entry.task, tuple(dict.fromkeys(problems)), tuple(solvers), **how)

    for entry in config.experiment:
        methods = entry.methods or config.methods
        yield plan(entry, (each.solver() for each in methods), epsilons=entry.epsilons, limit=entry.limit)
    if (registration := config.registration) is not None:
        for entry in registration.sets:
            pipelines = (each for each in registration.pipelines if each.solver().label not in entry.without)
            solvers = at_hand(pipelines)
            yield plan(entry, solvers, threads=(registration.threads,), limit=registration.limit)
    if (scenes := config.scenes) is not None:
        solvers, threads = tuple(at_hand(scenes.solvers)), (scenes.threads,)
        for entry in scenes.sets:
            bags = _list_bags(entry, config.seed) if opened.find_scans(entry.dataset) else ()
            yield PlannedSet(entry, entry.task, tuple(bags), solvers, threads=threads, limit=scenes.limit)
    if (trials := config.trials) is not None:
        for entry in trials.sets:
            methods = entry.methods or trials.methods or config.methods
            solvers = (_with_preset(each.solver(), entry.preset) for each in methods)
            yield plan(entry, solvers, threads=trials.threads, limit=trials.limit)


def _with_preset(method: Solver, preset: str) -> Solver:
    """Add the options of a preset to those that the method has."""
    options = PRESETS[preset].get(method.name, {})
    return replace(method, options=json.dumps({**options, **json.loads(method.options)}, sort_keys=True))


def _list_bags(entry: SceneSetEntry, seed: int) -> Iterator[Problem]:
    kind = "mirrored" if entry.mirrored else "related"
    for each in dict.fromkeys(entry.seeds or (seed,)):
        yield Problem("scenes", AND.join(entry.dataset), f"seed {each}", kind, seed=each)


def _list_problems(entry: PairsEntry, name: str, opened: _OpenDatasets, seed: int) -> Iterator[Problem]:
    if isinstance(entry, TrialSetEntry) and entry.grid is not None:
        for recipe in entry.grid.recipes():
            kind = "related" if recipe.inliers else "mixed"
            yield Problem("matches", name, recipe.name, kind, epsilon=entry.epsilon, seed=seed)
        return
    ready_made = opened.comes_as_matches(name)
    _check_role(entry, name, ready_made=ready_made)
    pairs = opened.draw_pairs(entry, name, seed)
    if isinstance(entry, ExperimentEntry):
        combinations = (READY_MADE,) if ready_made else entry.combinations
        for pair, level, combination in itertools.product(pairs, entry.levels or (None,), combinations):
            problem = Problem("experiment", name, pair, matches=combination, seed=seed)
            if entry.sweep:
                problem = replace(problem, nms_radius=level)
            else:
                problem = replace(problem, nuisance=entry.nuisance, level=level)
            yield replace(problem, front=entry.front.changes(problem.detector, problem.nuisance))
        return
    assert isinstance(entry, UnrelatedSetEntry)  # noqa: S101 - there is no other
    mixed = mixed_names(opened.found[name]) if entry.mixed else []
    among = [both for both in mixed if set(both) <= set(pairs)]
    kinds: list[tuple[str, Kind, str]] = [
        *((pair, "related", "") for pair in pairs),
        *((pair, "mirrored", "") for pair in _draw("mirrored", entry.mirrored, pairs, seed, name)),
        *((pair, "mixed", other) for pair, other in _draw("mixed", entry.mixed, among, seed, name)),
    ]
    rest: dict[str, Any] = {"voxel": entry.voxel, "seed": seed}
    if isinstance(entry, TrialSetEntry):
        rest |= {"matches": entry.matches, "epsilon": entry.epsilon}
    for pair, kind, other in kinds:
        yield Problem(entry.task, name, pair, kind, other, **rest)


def _check_role(entry: PairsEntry, name: str, *, ready_made: bool) -> None:
    """Refuse a set that asks for clouds where there are matches, or the other way round."""
    asking, refusal = _ASKING_FOR_CLOUDS[entry.task]
    message = ""
    if ready_made and entry.model_dump(include=asking, exclude_defaults=True):
        message = f"{entry.id}: {name} comes as correspondences; {refusal}"
    elif not ready_made and isinstance(entry, TrialSetEntry) and not entry.matches:
        message = f"{entry.id}: {name} has clouds; matches says how they are matched"
    if message:
        raise InputError(message)


def _plan_timing(config: Config, timing: TimingEntry, opened: _OpenDatasets) -> PlannedSet:
    """Plan the timing on the first data set that is at hand."""
    name = next(filter(opened.open, timing.dataset), None)
    if name is None:
        reasons = "; ".join(f"{name}: {opened.missing[name]}" for name in timing.dataset)
        message = f"timing: none of the data sets is at hand; {reasons}"
        raise InputError(message)
    if opened.comes_as_matches(name):
        message = f"timing: {name} comes as correspondences; sets of several sizes need clouds"
        raise InputError(message)
    pair = timing.pair if timing.pair is not None else opened.pairs[name][0]
    sizes = sorted(set(timing.sizes))
    problems = tuple(Problem("timing", name, pair, size=size, seed=config.seed) for size in sizes)
    solvers = tuple(each.solver() for each in timing.methods or config.methods)
    return PlannedSet(timing, "timing", problems, solvers, timing.threads)


def _draw(purpose: str, count: int, items: Sequence[Item], seed: int, name: str) -> list[Item]:
    """Draw some of a data set's items without replacement, in their order; all if there are fewer."""
    order = keyed_rng(purpose, seed, name).permutation(len(items))
    return [items[i] for i in sorted(order[:count])]


def _describe(name: str, dataset: Dataset, planned: Iterable[PlannedSet]) -> DatasetFacts:
    """Collect the facts about a data set and its pairs in use."""
    used = {problem.pair for each in planned for problem in each.problems if problem.dataset == name}
    pairs = {pair: (dataset.origin_of(pair), dataset.protocols_of(pair)) for pair in sorted(used)}
    for unknown in (each for _, names in pairs.values() for each in names if each not in PROTOCOLS):
        message = f"{dataset.name}: there is no protocol {unknown!r}; there are {', '.join(PROTOCOLS)}"
        raise InputError(message)
    return DatasetFacts(name, dataset.title, dataset.role, dataset.origin, dataset.citation, pairs)
