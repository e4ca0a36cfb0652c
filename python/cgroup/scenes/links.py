"""The pose between two scans, with its probability."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from cgroup._runtime.progress import StageClock, ignore_progress
from cgroup.registration import PreparedScan, pairwise
from cgroup.rigid.se3 import adjoint
from cgroup.types import FloatArray, IndexArray

Pair: TypeAlias = "tuple[int, int]"
"""Rows of the source and of the target."""


@dataclass(frozen=True, eq=False)
class Link:
    """Poses of one scan on another, the best first, with their probabilities."""

    poses: FloatArray  # (k,4,4), poses of the source in the target's frame: the best, then its rivals
    chances: FloatArray  # (k,), probability that each is right
    covariance: FloatArray  # (6,6), of the best one, as `Registration.covariance`; NaN if it was not computed
    fitness: float  # share of the source's surface that overlaps the target's under the best one
    target_fitness: float  # share of the target's surface that overlaps the source's
    decoy: float = np.nan  # probability of the best pose of the mirrored source; NaN if none was searched for

    @property
    def pose(self) -> FloatArray:
        """The best pose."""
        return self.poses[0]

    @property
    def probability(self) -> float:
        """Probability that the best pose is correct."""
        return float(self.chances[0])

    @property
    def overlap(self) -> float:
        """Overlap of both surfaces under the best pose."""
        return min(self.fitness, self.target_fitness)

    @property
    def is_accepted(self) -> bool:
        """Whether the best pose is accepted from the two scans only."""
        rivals = self.chances[1:] >= pairwise.AS_GOOD * self.probability
        return pairwise.is_accepted(self.probability, has_rivals=bool(rivals.any()))

    @property
    def inverse(self) -> Link:
        """The inverse link, with source and target swapped."""
        back = np.asarray(np.linalg.inv(self.poses), np.float64)
        change = adjoint(back[0])  # T^-1 = Exp(-Ad(T^-1) x) T_found^-1
        covariance = change @ self.covariance @ change.T
        return Link(back, self.chances, covariance, self.target_fitness, self.fitness, self.decoy)


def stack_links(
    links: Mapping[Pair, Link], pairs: Sequence[Pair]
) -> tuple[IndexArray, FloatArray, FloatArray, FloatArray]:
    """Return pairs (n,2) with their best poses (n,4,4), covariances (n,6,6) and overlaps (n,)."""
    some = [links[pair] for pair in pairs]
    return (
        np.array(pairs, dtype=np.int64).reshape(-1, 2),
        np.array([one.pose for one in some]).reshape(-1, 4, 4),
        np.array([one.covariance for one in some]).reshape(-1, 6, 6),
        np.array([one.overlap for one in some]),
    )


def link(
    source: PreparedScan,
    target: PreparedScan,
    axis: FloatArray | None,
    effort: pairwise.Depth,
    proposed: FloatArray | None = None,
) -> Link | None:
    """Register two scans; None if there is no candidate pose."""
    search = pairwise.Search("lc", {}, axis, effort, 1, StageClock(ignore_progress), proposed=proposed)
    found = search.run(*_oriented_alike(source, target))
    if found is None:
        return None
    chances = found.probability * np.concatenate([[1.0], np.minimum(found.shares, 1.0)])
    total = chances.sum()
    chances *= pairwise.bound_by_motions(total, found.motions) / total  # for any best pose
    places = np.concatenate([found.pose[None], found.places[1:]])
    decoy = np.nan if found.decoy is None else found.decoy
    return Link(places, chances, found.covariance(), found.fitness, found.target_fitness, decoy)


def confirm(source: PreparedScan, target: PreparedScan, pose: FloatArray) -> Link | None:
    """Refine a predicted pose, and estimate its probability alone; None without overlap."""
    found = pairwise.confirm_pose(*_oriented_alike(source, target), pose, 1)
    return None if found is None else _link_of(found, found.covariance())


def weigh_pose(source: PreparedScan, target: PreparedScan, pose: FloatArray) -> Link | None:
    """Refine and judge a predicted pose without its covariance, the slowest part."""
    found = pairwise.confirm_pose(*_oriented_alike(source, target), pose, 1)
    return None if found is None else _link_of(found, np.full((6, 6), np.nan))


def _link_of(found: pairwise.Found, covariance: FloatArray) -> Link:
    chances = np.array([found.probability])
    return Link(found.pose[None], chances, covariance, found.fitness, found.target_fitness)


def _oriented_alike(source: PreparedScan, target: PreparedScan) -> tuple[PreparedScan, PreparedScan]:
    if source.by_frames or target.by_frames:
        return source.turned_by_frames, target.turned_by_frames
    return source, target
