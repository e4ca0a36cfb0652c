"""Find models in a scene one after another; each removes the part of the scene that it covers.

A correct model agrees with the scene wherever the scanner should have seen it, up to noise and curvature. A
wrong one may cover as much of the scene, but deviates elsewhere, or violates free space.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cgroup._runtime.progress import StageClock
from cgroup._runtime.workers import cached_property
from cgroup.errors import InputError
from cgroup.features import DescribedCloud
from cgroup.fronts.matching import frame_poses, match_both_ways, propose_poses, take_matches
from cgroup.registration.pairwise import (
    LEAST_VOXELS,
    PreparedScan,
    Registration,
    confirm_pose,
    is_accepted,
    judge,
    registration_of,
)
from cgroup.rigid import invert
from cgroup.types import BoolArray, Correspondences, FloatArray, IndexArray
from cgroup.verification import Alignment, Place, align, places, verify

_SPACINGS = (1 / 2, 1.0)
_BACKGROUND = 0.3  # of a point that should have been seen: scans have holes
_CHANCE = 10.0  # points that agree by chance
_EVIDENCE = 0.01
_RESIDUAL = 0.08
_MIDDLE, _STEEPNESS = 0.815, 60.0
_MIDDLE_UNSEEN = 0.72  # without a viewpoint, hidden points near the scene count as off it
_SAME_PLACE = 0.8  # fraction of the voxels of one pose that another pose also covers
_AS_GOOD = 0.8  # share of the score of a pose from which another is its alternative


@dataclass(frozen=True, eq=False)
class Detection:
    """A model at a pose in a scene."""

    model: PreparedScan  # with the same voxel
    scene: PreparedScan
    pose: FloatArray  # (4,4), maps the model into the scene
    score: float  # of the pose, by `cgroup.verification.verify`
    evidence: int  # number of matches that agree with the pose
    seen: IndexArray  # (5,), number of the model's voxels at each `Place`
    explained: BoolArray  # (M,), mask of the voxels of the scene on the model
    threads: int | None

    @cached_property
    def refined(self) -> Alignment:
        """The pose refined at half the voxel."""
        for share in _SPACINGS:
            model, scene = self.model.fine_surface(share), self.scene.fine_surface(share)
            if model is not None and scene is not None:
                return align(model, scene, self.pose, threads=self.threads)
        cause = f"{self.model.voxel:.4g}, at which model or scene has too few points next to each other"
        raise InputError("voxel", cause, "give a larger `voxel`")

    @property
    def visible(self) -> float:
        """Fraction of the model's surface that is visible in the scene."""
        return float(self.seen[Place.ON] / self.seen.sum())

    def probability(self, free: BoolArray) -> float:
        """Return the probability of the pose, given the voxels of the scene that may belong to the model."""
        value = self._value(free)
        middle = _MIDDLE_UNSEEN if self.scene.viewpoint is None else _MIDDLE
        if value > middle:
            value -= _RESIDUAL * max(_misfit(self.refined) - 1, 0)
        return 1 / (1 + math.exp(min(-_STEEPNESS * (value - middle), 700)))

    def _value(self, free: BoolArray) -> float:
        """Return the unclaimed fraction of the voxels that should be visible, minus the expected fraction."""
        all_explained = int(self.explained.sum())
        if all_explained == 0:
            return -math.inf
        share = int((self.explained & free).sum()) / all_explained
        on = float(self.seen[Place.ON]) * share
        should_be_seen = float(self.seen[Place.ON : Place.BACKGROUND].sum())
        should_be_seen += _BACKGROUND * float(self.seen[Place.BACKGROUND])
        if on == 0:
            return -math.inf
        return on / should_be_seen - _CHANCE / on + _EVIDENCE * math.log1p(self.evidence)


def look_at(
    model: PreparedScan,
    scene: PreparedScan,
    pose: FloatArray,
    score: float,
    evidence: int,
    threads: int | None,
) -> Detection:
    """Compare both surfaces under a pose."""
    seen = np.bincount(places(model.surface, scene.surface, pose, threads=threads), minlength=len(Place))
    explained = places(scene.surface, model.surface, invert(pose), threads=threads) == Place.ON
    return Detection(model, scene, pose, score, evidence, seen, explained, threads)


def _misfit(aligned: Alignment) -> float:
    """Return the residuals over the deviation by noise and curvature; infinite without pairs."""
    if len(aligned.residuals) == 0:
        return math.inf
    expected = float(np.sqrt(np.mean(aligned.deviations**2)))
    return aligned.rmse / expected if expected > 0 else math.inf


@dataclass(frozen=True, eq=False)
class Proposal:
    """A proposed pose of a model."""

    name: str  # of the model
    detection: Detection  # its pose
    others: FloatArray  # (k,4,4), other poses at the same place that score almost as well
    matches: Correspondences  # of the search that found it

    def registration(self, probability: float, seconds: dict[str, float]) -> Registration:
        """Return the result."""
        detection = self.detection
        model, scene, pose = detection.model, detection.scene, detection.refined.T_target_source
        found = confirm_pose(model, scene, pose, detection.threads)
        assert found is not None  # noqa: S101 - a detection has a surface in common with the scene
        found = replace(
            found,
            pose=pose,
            alternatives=self.others,
            probability=probability,
            fitness=detection.visible,
            target_fitness=float(detection.explained.mean()),
            matches=self.matches,
        )
        return registration_of(found, judge(found, model, scene), seconds)


@dataclass(eq=False)
class InstanceSearch:
    """Searches for models in a scene until none is found."""

    models: Mapping[str, PreparedScan]  # by name
    scene: PreparedScan  # with the same voxel, and normals on the same side
    most: int | None  # largest number of instances of a model
    threads: int | None
    clock: StageClock
    free: BoolArray = field(init=False)  # (M,), mask of the voxels of the scene that no model explains yet

    def __post_init__(self) -> None:
        self.free = np.ones(len(self.scene), dtype=bool)

    def run(self) -> list[tuple[Proposal, float]]:
        """Return the models found with their probabilities, in the order found."""
        found: list[tuple[Proposal, float]] = []
        while self._find_more(found, thoroughly=False) or self._find_more(found, thoroughly=True):
            pass
        return found

    def _find_more(self, found: list[tuple[Proposal, float]], *, thoroughly: bool) -> bool:
        """Search the free part of the scene with mutual matches; with all for models not found yet."""
        before = len(found)
        missing = set(self.models) - {one.name for one, _ in found}
        wanted = missing if thoroughly else self.models
        proposals = [
            proposal
            for name in self.models
            if name in wanted and not self._is_complete(name, found)
            for proposal in self._propose(name, thoroughly=thoroughly)
        ]
        self._accept(proposals, found)
        return len(found) > before

    def _is_complete(self, name: str, found: list[tuple[Proposal, float]]) -> bool:
        return self.most is not None and sum(one.name == name for one, _ in found) >= self.most

    def _accept(self, proposals: list[Proposal], found: list[tuple[Proposal, float]]) -> None:
        """Accept the most probable proposal and remove its part of the scene, while one is accepted."""
        self.clock.start("refinement")
        while True:
            rated = [
                (proposal.detection.probability(self.free), proposal)
                for proposal in proposals
                if not self._is_complete(proposal.name, found)
            ]
            if not rated:
                return
            probability, best = max(rated, key=lambda pair: pair[0])
            if not is_accepted(probability):
                return
            found.append((best, probability))
            self.free &= ~best.detection.explained

    def _propose(self, name: str, *, thoroughly: bool) -> list[Proposal]:
        model, free = self.models[name], self._free_part()
        if len(free) < LEAST_VOXELS:
            return []
        self.clock.start("matching")
        matches, is_mutual = match_both_ways(model.described, free, 1, self.threads)
        mutual = take_matches(matches, is_mutual)
        self.clock.start("grouping")
        poses = propose_poses(matches if thoroughly else mutual, "lc", self.threads)
        self.clock.start("verification")
        poses = np.concatenate([poses, frame_poses(mutual)])
        return self._verify(name, poses, mutual, matches) if len(poses) else []

    def _free_part(self) -> DescribedCloud:
        whole = self.scene.described
        free = self.free[whole.indices]
        rows = whole.indices[free], whole.points[free], whole.lrf[free], whole.descriptors[free]
        return DescribedCloud(*rows, whole.resolution, whole.centroid)

    def _verify(
        self, name: str, poses: FloatArray, mutual: Correspondences, matches: Correspondences
    ) -> list[Proposal]:
        model, scene = self.models[name], self.scene
        verified = verify(model.surface, scene.surface, poses, matches=mutual, threads=self.threads)
        rows = zip(verified.poses, verified.scores.tolist(), verified.evidence.tolist(), strict=True)
        found = [look_at(model, scene, *row, self.threads) for row in rows]
        return [Proposal(name, one, _others(one, found), matches) for one in found]


def _others(one: Detection, detections: list[Detection]) -> FloatArray:
    """Return the poses that cover the same voxels almost as well."""
    explained = int(one.explained.sum())
    poses: list[Any] = [
        other.pose
        for other in detections
        if other is not one
        and other.score >= _AS_GOOD * max(one.score, 0)
        and int((one.explained & other.explained).sum()) >= _SAME_PLACE * explained
    ]
    return np.array(poses).reshape(-1, 4, 4)
