"""Which matches are to be grouped, and by which methods."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from cgroup.benchmark.cases import READY_MADE, Problem
from cgroup.benchmark.plan.datasets import draw, draw_pairs
from cgroup.datasets import mixed_names
from cgroup.datasets.generated_matches import GeneratedMatches
from cgroup.errors import InputError
from cgroup.registry import PRESETS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.config import Config, GridEntry, TrialSetEntry
    from cgroup.benchmark.plan.datasets import OpenDatasets


@dataclass(frozen=True)
class PlannedTrials:
    """A set of problems and what it needs.

    Attributes
    ----------
    entry : TrialSetEntry
        As configured.
    cases : tuple of Problem
        To be grouped, in this order.
    methods : tuple of Candidate
        To be run on each.
    threads : tuple of int
        For each.
    limit : float
        Seconds after which a call is given up.
    missing : dict of str to str
        Data sets that are not at hand, or not whole, and why.
    """

    entry: TrialSetEntry
    cases: tuple[Problem, ...]
    methods: tuple[Candidate, ...]
    threads: tuple[int, ...]
    limit: float
    missing: dict[str, str]


def plan_trials(config: Config, opened: OpenDatasets) -> Iterator[PlannedTrials]:
    """Find the problems of each set.

    Raises
    ------
    InputError
        If a set says how ready-made matches are made, or not how others are, or a pair is named that
        doesn't exist.
    """
    trials = config.trials
    if trials is None:
        return
    for entry in trials.sets:
        names = entry.dataset or (GeneratedMatches.name,)
        at_hand = [name for name in names if opened.open(name)]
        missing = {name: opened.missing[name] for name in names if name in opened.missing}
        cases = tuple(case for name in at_hand for case in _list_cases(entry, name, opened, config.seed))
        chosen = entry.methods or trials.methods or config.methods
        methods = tuple(_with_preset(each.candidate(), entry.preset) for each in chosen)
        yield PlannedTrials(entry, cases, methods, trials.threads, trials.limit, missing)


def _list_cases(entry: TrialSetEntry, name: str, opened: OpenDatasets, seed: int) -> Iterator[Problem]:
    if entry.grid is not None:
        yield from _list_generated(entry.grid, entry.epsilon, seed)
        return
    dataset = opened.found[name]
    ready_made = dataset.role == "correspondences"
    if ready_made and (entry.matches or entry.mirrored or entry.mixed):
        message = f"{entry.id}: {name} comes as correspondences; leave out matches, mirrored and mixed"
        raise InputError(message)
    if not ready_made and not entry.matches:
        message = f"{entry.id}: {name} has clouds; matches says how they are matched"
        raise InputError(message)
    how = entry.matches if not ready_made else READY_MADE
    pairs = draw_pairs(entry.id, entry.pairs, name, opened, seed)
    rest: dict[str, Any] = {"matches": how, "voxel": entry.voxel, "epsilon": entry.epsilon, "seed": seed}
    for pair in pairs:
        yield Problem(name, pair, **rest)
    for pair in draw("mirrored", entry.mirrored, pairs, seed, name):
        yield Problem(name, pair, "mirrored", **rest)
    mixed = [both for both in mixed_names(dataset) if set(both) <= set(pairs)] if entry.mixed else []
    for pair, other in draw("mixed", entry.mixed, mixed, seed, name):
        yield Problem(name, pair, "mixed", other, **rest)


def _list_generated(grid: GridEntry, epsilon: float, seed: int) -> Iterator[Problem]:
    for recipe in grid.recipes():
        kind = "related" if recipe.inliers else "mixed"
        yield Problem(GeneratedMatches.name, recipe.name, kind, epsilon=epsilon, seed=seed)


def _with_preset(method: Candidate, preset: str) -> Candidate:
    """Add the options of a preset to those that the method has."""
    options = PRESETS[preset].get(method.name, {})
    return replace(method, options=json.dumps({**options, **json.loads(method.options)}, sort_keys=True))
