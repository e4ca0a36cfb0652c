"""Find models in a scene one after the other; each removes the part of the scene that it explains."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cgroup._runtime.progress import StageClock
from cgroup.features import DescribedCloud
from cgroup.registration.covariance import count_open_motions
from cgroup.registration.judge import Found, is_accepted, judge
from cgroup.registration.matching import frame_poses, match_both_ways, propose_poses, take_matches
from cgroup.registration.prepare import LEAST_VOXELS, PreparedScan
from cgroup.registration.recognition.sighting import Sighting, look_at
from cgroup.registration.result import Registration, registration_of
from cgroup.types import BoolArray, Correspondences, FloatArray
from cgroup.verification import verify

_SAME_PLACE = 0.8  # of what one pose explains that another explains too
_AS_GOOD = 0.8


@dataclass(frozen=True, eq=False)
class Proposal:
    """A proposed pose of a model.

    Attributes
    ----------
    name : str
        Of the model.
    sighting : Sighting
        Its pose.
    others : (k,4,4) array of float64
        Other poses at the same place that score almost as well.
    matches : Correspondences
        Of the search that found it.
    """

    name: str
    sighting: Sighting
    others: FloatArray
    matches: Correspondences

    def registration(self, probability: float, seconds: dict[str, float]) -> Registration:
        """Return the result."""
        sighting = self.sighting
        found = Found(
            sighting.refined,
            self.others,
            probability,
            sighting.visible,
            self.matches,
            sighting.model,
            sighting.scene,
            target_fitness=float(sighting.explained.mean()),
            motions=count_open_motions(sighting.refined, sighting.model, sighting.scene),
        )
        return registration_of(found, judge(found, sighting.model, sighting.scene), seconds)


@dataclass(eq=False)
class InstanceSearch:
    """Searches for models in a scene until none is found.

    Attributes
    ----------
    models : mapping of str to PreparedScan
        By name.
    scene : PreparedScan
        With the same voxel, and normals on the same side.
    most : int or None
        Largest number of instances of a model.
    free : (M,) array of bool
        Mask of the voxels of the scene that no model explains yet.
    """

    models: Mapping[str, PreparedScan]
    scene: PreparedScan
    most: int | None
    threads: int | None
    clock: StageClock
    free: BoolArray = field(init=False)

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
                (proposal.sighting.probability(self.free), proposal)
                for proposal in proposals
                if not self._is_complete(proposal.name, found)
            ]
            if not rated:
                return
            probability, best = max(rated, key=lambda pair: pair[0])
            if not is_accepted(probability):
                return
            found.append((best, probability))
            self.free &= ~best.sighting.explained

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
        return DescribedCloud(
            whole.indices[free],
            whole.points[free],
            whole.lrf[free],
            whole.descriptors[free],
            whole.resolution,
            whole.centroid,
        )

    def _verify(
        self, name: str, poses: FloatArray, mutual: Correspondences, matches: Correspondences
    ) -> list[Proposal]:
        model, scene = self.models[name], self.scene
        verified = verify(model.surface, scene.surface, poses, matches=mutual, threads=self.threads)
        rows = zip(verified.poses, verified.scores.tolist(), verified.evidence.tolist(), strict=True)
        sightings = [
            look_at(model, scene, pose, score, evidence, self.threads) for pose, score, evidence in rows
        ]
        return [Proposal(name, sighting, _others(sighting, sightings), matches) for sighting in sightings]


def _others(one: Sighting, sightings: list[Sighting]) -> FloatArray:
    """Return the poses that explain the same voxels almost as well."""
    explained = int(one.explained.sum())
    poses: list[Any] = [
        other.pose
        for other in sightings
        if other is not one
        and other.score >= _AS_GOOD * max(one.score, 0)
        and int((one.explained & other.explained).sum()) >= _SAME_PLACE * explained
    ]
    return np.array(poses).reshape(-1, 4, 4)
