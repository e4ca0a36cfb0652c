"""Problems to be solved: a pair disturbed and matched in one way, clouds to be registered, or matches."""

from __future__ import annotations

import functools
import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from cgroup import features
from cgroup.datasets import CorrespondencePair, MatchingPair, mirror, mix, open_dataset
from cgroup.errors import InputError
from cgroup.evaluation import within
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN
from cgroup.rigid import apply

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cgroup.datasets import Dataset, UnrelatedPair
    from cgroup.registration import Descriptor, Detector
    from cgroup.types import FloatArray, RealArray

COMBINATIONS: Mapping[str, tuple[Detector, Descriptor]] = {
    "C1": ("h3d", "shot"),
    "C2": ("h3d", "lfsh"),
    "C3": ("h3d", "rcs"),
    "C4": ("iss", "shot"),
    "C5": ("iss", "lfsh"),
    "C6": ("iss", "rcs"),
}
"""The paper's detectors and descriptors (section 4.3)."""

DENSE_MATCHES = ("nearest", "mutual", "three nearest", "nearest, unit length")
"""How voxels described by FPFH are matched: each with its nearest, with those whose nearest it is, with its
three nearest; or with the nearest by descriptors of unit length, as for published results on 3DMatch."""

READY_MADE = ""
"""In place of a combination where pairs come as correspondences."""

Task: TypeAlias = Literal["experiment", "registration", "scenes", "matches", "timing"]
"""The paper's experiments; two clouds, or many scans, to be registered; matches to be grouped, each method
alone; the timing."""

Kind: TypeAlias = Literal["related", "mirrored", "mixed"]

AND = " + "
"""Stands between the names of places whose scans are in one bag."""

OVERLAP_SAMPLE = 1000
"""Source points in the overlap on which the error of an estimated pose is measured, at most."""

_CANDIDATES_PER_SAMPLE = 5  # source points that are tried, per point of the sample
_PAIRS_KEPT = 2  # loaded pairs that a worker keeps: its next task is often about one of them

_KEY_FIELDS: dict[Task, tuple[str, ...]] = {
    "experiment": ("dataset", "pair", "nuisance", "level", "matches", "nms_radius", "seed", "front"),
    "registration": ("dataset", "pair", "kind", "other", "voxel", "seed"),
    "scenes": ("task", "dataset", "kind", "seed"),
    "matches": ("dataset", "pair", "kind", "other", "matches", "voxel", "epsilon", "seed"),
    "timing": ("task", "dataset", "pair", "size", "seed"),
}


@dataclass(frozen=True)
class Problem:
    """One problem for solvers; sets that ask for the same one share it.

    Attributes
    ----------
    task : {"experiment", "registration", "scenes", "matches", "timing"}
        The kind of set that asks for it.
    dataset, pair, kind, other : str
        The pair itself, mirrored, or mixed: its source with the target of another pair. Ready-made matches
        without a right one are "mixed". Of scenes `dataset` names all places by `AND` between them, and
        "mirrored" has each of them once more, mirrored.
    nuisance, level : str, float or None
        Disturbance of the pair and its amount, if any.
    matches : str
        How clouds are matched: one of `COMBINATIONS` or `DENSE_MATCHES`, or `READY_MADE`.
    nms_radius : float or None
        Of the detector, in pr; its own by default.
    front : str
        Changes of the paper's front end, as `FrontEntry.changes` writes them; empty for none.
    voxel : float or None
        Edge length of the voxels in the data's unit; chosen for the pair by default.
    epsilon : float
        A match is correct when it misses its place by at most so many times the matches' resolution.
    size : int
        Keypoints aimed at, for the timing.
    seed : int
        Key of all random numbers.
    """

    task: Task
    dataset: str
    pair: str
    kind: Kind = "related"
    other: str = ""
    nuisance: str = ""
    level: float | None = None
    matches: str = READY_MADE
    nms_radius: float | None = None
    front: str = ""
    voxel: float | None = None
    epsilon: float = 5.0
    size: int = 0
    seed: int = 0

    @property
    def key(self) -> str:
        """Hash of all fields of the task, the same in every process and on every machine."""
        fields = {name: getattr(self, name) for name in _KEY_FIELDS[self.task]}
        if self.task == "experiment":
            fields["combination"] = fields.pop("matches")
            if not self.front:
                del fields["front"]
        return _digest(fields).hex()[:24]

    @property
    def detector(self) -> str:
        """Keypoint detector; empty for matches of another kind."""
        return COMBINATIONS.get(self.matches, ("", ""))[0]

    @property
    def descriptor(self) -> str:
        """Descriptor; empty for matches of another kind."""
        return COMBINATIONS.get(self.matches, ("", ""))[1]

    def rng(self, purpose: str) -> np.random.Generator:
        """Random numbers that depend on seed, pair, nuisance and level alone."""
        disturbed = (self.nuisance, self.level) if self.task == "experiment" else ()
        return keyed_rng(purpose, self.seed, self.dataset, self.pair, *disturbed)

    def load(self, root: str | None) -> LoadedProblem:
        """Load the pair; mirror its target or mix it with the other pair's.

        Raises
        ------
        InputError
            If the data can't be read, or pairs that come as matches are to be registered or mixed.
        """
        pair = load_pair(self.dataset, self.pair, root)
        truth = pair.T_target_source if self.kind == "related" else None
        if isinstance(pair, CorrespondencePair):
            if self.task == "registration":
                message = f"{self.dataset}: {self.pair} comes as correspondences; registering needs clouds"
                raise InputError(message)
            return LoadedProblem(pair, None, truth)
        if self.kind != "mixed":
            return LoadedProblem(pair, pair if self.kind == "related" else mirror(pair), truth)
        other = load_pair(self.dataset, self.other, root)
        if isinstance(other, CorrespondencePair):
            message = f"{self.dataset}: {self.other} comes as correspondences; only clouds can be mixed"
            raise InputError(message)
        return LoadedProblem(pair, mix(pair, other), truth)


@dataclass(frozen=True, eq=False)
class LoadedProblem:
    """A loaded pair, the clouds of the problem (none of ready-made matches), and the true pose if any."""

    pair: MatchingPair | CorrespondencePair
    clouds: MatchingPair | UnrelatedPair | None
    truth: FloatArray | None

    @property
    def points(self) -> tuple[RealArray, RealArray]:
        """Points of both clouds, or both ends of all matches."""
        if self.clouds is not None:
            return self.clouds.source.points, self.clouds.target.points
        assert isinstance(self.pair, CorrespondencePair)  # noqa: S101 - else there are clouds
        return self.pair.correspondences.source, self.pair.correspondences.target

    def measure_pr(self) -> float:
        """Mean distance of neighbours in both clouds, in the data's unit."""
        if isinstance(self.pair, CorrespondencePair):
            return known_resolution(self.pair.correspondences.resolution)
        return (features.resolution(self.points[0]) + features.resolution(self.points[1])) / 2

    def draw_sample(self, pr: float, rng: np.random.Generator) -> RealArray:
        """Draw source points in the overlap; none without a true pose."""
        if self.truth is None:
            return np.empty((0, 3))
        return overlap_sample(*self.points, self.truth, pr, rng)

    @property
    def overlap(self) -> float | None:
        """Share that both clouds have in common; None where it isn't known."""
        return None if self.truth is None else self.pair.facts.get("overlap")


def known_resolution(resolution: float | None) -> float:
    """Return the resolution of matches; raise `InputError` for matches without one."""
    if resolution is None:
        message = "correspondences without a resolution; thresholds in pr need one"
        raise InputError(message)
    return resolution


def overlap_sample(
    source: RealArray, target: RealArray, truth: FloatArray, pr: float, rng: np.random.Generator
) -> RealArray:
    """Draw at most `OVERLAP_SAMPLE` source points that lie close to the target under the true pose."""
    tried = source[rng.permutation(len(source))[: _CANDIDATES_PER_SAMPLE * OVERLAP_SAMPLE]]
    close = within(apply(truth, tried), target, OVERLAP_WITHIN * pr)
    return tried[close][:OVERLAP_SAMPLE]


def keyed_rng(*key: object) -> np.random.Generator:
    """Random numbers by a key, the same in every process (unlike those seeded by `hash`)."""
    return np.random.default_rng(np.frombuffer(_digest(key), dtype="<u4"))


@functools.lru_cache(maxsize=8)
def open_once(name: str, root: str | None) -> Dataset:
    """Open a data set, the first time it is asked for."""
    return open_dataset(name, None if root is None else Path(root))


@functools.lru_cache(maxsize=_PAIRS_KEPT)
def load_pair(dataset: str, name: str, root: str | None) -> MatchingPair | CorrespondencePair:
    """Load a pair, unless it is one of the last."""
    return open_once(dataset, root).load(name)


def _digest(value: object) -> bytes:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).digest()
