"""Which pairs of clouds are to be registered, and how."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from cgroup.benchmark.cases import PairCase
from cgroup.benchmark.plan.datasets import draw, draw_pairs
from cgroup.datasets import mixed_names
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from cgroup.benchmark.config import Config, PairSetEntry, PipelineEntry
    from cgroup.benchmark.pipelines import Pipeline
    from cgroup.benchmark.plan.datasets import OpenDatasets


@dataclass(frozen=True)
class PlannedSet:
    """A set of pairs and what it needs.

    Attributes
    ----------
    entry : PairSetEntry
        As configured.
    cases : tuple of PairCase
        To be registered.
    pipelines : tuple of Pipeline
        To be run on each.
    threads : int
        For each.
    missing : dict of str to str
        Data sets and pipelines that are not at hand, and why.
    """

    entry: PairSetEntry
    cases: tuple[PairCase, ...]
    pipelines: tuple[Pipeline, ...]
    threads: int
    missing: dict[str, str]


def plan_sets(config: Config, opened: OpenDatasets) -> Iterator[PlannedSet]:
    """Find the pairs of each set.

    Raises
    ------
    InputError
        If a set has no clouds, or a pair is named that doesn't exist.
    """
    if config.registration is None:
        return
    for entry in config.registration.sets:
        at_hand = [name for name in entry.dataset if opened.open(name)]
        missing = {name: opened.missing[name] for name in entry.dataset if name in opened.missing}
        cases = tuple(case for name in at_hand for case in _list_cases(entry, name, opened, config.seed))
        pipelines, absent = _find_pipelines(config.registration.pipelines, entry.without)
        yield PlannedSet(entry, cases, pipelines, config.registration.threads, missing | absent)


def _list_cases(entry: PairSetEntry, name: str, opened: OpenDatasets, seed: int) -> Iterator[PairCase]:
    dataset = opened.found[name]
    if dataset.role == "correspondences":
        message = f"{entry.id}: {name} comes as correspondences; registering needs clouds"
        raise InputError(message)
    pairs = draw_pairs(entry.id, entry.pairs, name, opened, seed)
    mixed = [both for both in mixed_names(dataset) if set(both) <= set(pairs)]
    for pair in pairs:
        yield PairCase(name, pair, voxel=entry.voxel, seed=seed)
    for pair in draw("mirrored", entry.mirrored, pairs, seed, name):
        yield PairCase(name, pair, "mirrored", voxel=entry.voxel, seed=seed)
    for pair, other in draw("mixed", entry.mixed, mixed, seed, name):
        yield PairCase(name, pair, "mixed", other, entry.voxel, seed)


def _find_pipelines(
    entries: Sequence[PipelineEntry], without: Sequence[str]
) -> tuple[tuple[Pipeline, ...], dict[str, str]]:
    """Tell the pipelines that can be run from those that can't, and say why."""
    pipelines = [pipeline for entry in entries if (pipeline := entry.pipeline()).label not in without]
    reasons = {pipeline.label: pipeline.why_missing() for pipeline in pipelines}
    found = tuple(pipeline for pipeline in pipelines if not reasons[pipeline.label])
    return found, {label: why for label, why in reasons.items() if why}
