"""Problems: disturbed and matched pairs, clouds or scans to register, or matches to group."""

import functools
import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np

from cgroup import datasets, features
from cgroup.errors import InputError
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN
from cgroup.features import within
from cgroup.registration import Descriptor, Detector
from cgroup.rigid import apply
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
"""How voxels are matched by FPFH: with the nearest, if each is nearest to the other, with the three nearest,
or with the nearest by descriptors of unit length, as in published results on 3DMatch."""

READY_MADE = ""  # in place of a combination, for data sets of correspondences
# What is asked of a problem; also the kinds of results
Task: TypeAlias = Literal["experiment", "timing", "registration", "scenes", "matches"]
Kind: TypeAlias = Literal["related", "mirrored", "mixed"]

AND = " + "  # separates the names of places whose scans are mixed
# Largest number of source points in the overlap on which the error of a pose is measured
OVERLAP_SAMPLE = 1000
_CANDIDATES_PER_SAMPLE = 5  # source points tried per point of the sample
_PAIRS_KEPT = 2  # loaded pairs that a worker keeps: its next task often needs one of them


@dataclass(frozen=True, eq=False)
class LoadedProblem:
    """A loaded pair, the clouds of the problem (None for ready-made matches), and the true pose if any."""

    pair: datasets.MatchingPair | datasets.CorrespondencePair
    clouds: datasets.MatchingPair | datasets.UnrelatedPair | None
    truth: FloatArray | None

    @property
    def points(self) -> tuple[RealArray, RealArray]:
        """Points of both clouds, or source and target points of all matches."""
        if self.clouds is not None:
            return self.clouds.source.points, self.clouds.target.points
        assert isinstance(self.pair, datasets.CorrespondencePair)  # noqa: S101 - else there are clouds
        return self.pair.correspondences.source, self.pair.correspondences.target

    def measure_pr(self) -> float:
        """Return the mean distance between neighbours in both clouds, in the data's unit."""
        if isinstance(self.pair, datasets.CorrespondencePair):
            return known_resolution(self.pair.correspondences.resolution)
        return (features.resolution(self.points[0]) + features.resolution(self.points[1])) / 2

    def draw_sample(self, pr: float, rng: np.random.Generator) -> RealArray:
        """Return random source points in the overlap; none without a true pose."""
        if self.truth is None:
            return np.empty((0, 3))
        return overlap_sample(*self.points, self.truth, pr, rng)

    @property
    def facts(self) -> dict[str, float]:
        """Known overlap, clutter and occlusion of a related pair."""
        return {} if self.truth is None else dict(self.pair.facts)


@dataclass(frozen=True)
class Problem:
    """One problem; sets with the same problem share it.

    It is a pair itself, mirrored, or mixed: its source with the target of the pair `other`. Ready-made
    matches without a correct one are "mixed". For scenes, `dataset` names all places, joined by `AND`;
    "mirrored" adds a mirrored copy of each.

    Clouds are disturbed by a `nuisance`, and matched by one of `COMBINATIONS` or `DENSE_MATCHES`. The radius
    `nms_radius` of the detector's non-maximum suppression is in pr; None for its own. `front` are changes to
    the paper's front end, from `FrontEntry.changes`. The `voxel` is chosen for the pair if it is None. The
    timing aims at `size` keypoints, and calls a method `repeats` times.
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
    size: int = 0
    repeats: int = 0
    seed: int = 0

    @property
    def key(self) -> str:
        """Hash of all fields, the same in every process and on every machine."""
        return _digest(asdict(self)).hex()[:24]

    @property
    def detector(self) -> str:
        """Keypoint detector of a combination, else empty."""
        return COMBINATIONS.get(self.matches, ("", ""))[0]

    @property
    def descriptor(self) -> str:
        """Descriptor of a combination, else empty."""
        return COMBINATIONS.get(self.matches, ("", ""))[1]

    def rng(self, purpose: str) -> np.random.Generator:
        """Return a generator keyed by seed, pair, nuisance and level only."""
        disturbed = (self.nuisance, self.level) if self.task == "experiment" else ()
        return keyed_rng(purpose, self.seed, self.dataset, self.pair, *disturbed)

    def load(self, root: str | None) -> LoadedProblem:
        """Load the pair; mirror its target or take that of another pair.

        Raises `InputError` if data can't be read, or correspondences are to be registered or mixed.
        """
        pair = load_pair(self.dataset, self.pair, root)
        truth = pair.T_target_source if self.kind == "related" else None
        if isinstance(pair, datasets.CorrespondencePair):
            if self.task == "registration":
                raise InputError(
                    f"{self.dataset}: {self.pair} consists of correspondences; registration needs clouds"
                )
            return LoadedProblem(pair, None, truth)
        if self.kind != "mixed":
            return LoadedProblem(pair, pair if self.kind == "related" else datasets.mirror(pair), truth)
        other = load_pair(self.dataset, self.other, root)
        if isinstance(other, datasets.CorrespondencePair):
            message = f"{self.dataset}: {self.other} consists of correspondences; only clouds can be mixed"
            raise InputError(message)
        return LoadedProblem(pair, datasets.mix(pair, other), truth)


def known_resolution(resolution: float | None) -> float:
    """Return the resolution; raise `InputError` for None."""
    if resolution is None:
        raise InputError("correspondences without a resolution; thresholds in pr need one")
    return resolution


def overlap_sample(
    source: RealArray, target: RealArray, truth: FloatArray, pr: float, rng: np.random.Generator
) -> RealArray:
    """Return at most `OVERLAP_SAMPLE` source points close to the target under the true pose."""
    tried = source[rng.permutation(len(source))[: _CANDIDATES_PER_SAMPLE * OVERLAP_SAMPLE]]
    close = within(apply(truth, tried), target, OVERLAP_WITHIN * pr)
    return tried[close][:OVERLAP_SAMPLE]


def keyed_rng(*key: object) -> np.random.Generator:
    """Return a generator seeded by a key, the same in every process."""
    return np.random.default_rng(np.frombuffer(_digest(key), dtype="<u4"))


@functools.lru_cache(maxsize=8)
def open_once(name: str, root: str | None) -> datasets.Dataset:
    """Open a data set once."""
    return datasets.open_dataset(name, None if root is None else Path(root))


@functools.lru_cache(maxsize=_PAIRS_KEPT)
def load_pair(
    dataset: str, name: str, root: str | None
) -> datasets.MatchingPair | datasets.CorrespondencePair:
    """Load a pair unless it is cached."""
    return open_once(dataset, root).load(name)


def _digest(value: object) -> bytes:
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).digest()
