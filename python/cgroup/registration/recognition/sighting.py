"""Compare a model with a scene under a pose, and estimate the probability of the pose.

A right model agrees with the scene wherever the scanner should have seen it, up to noise and curvature. A
wrong one may cover as much of the scene, but deviates elsewhere, or violates free space.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cgroup._runtime.cached import cached_property
from cgroup.registration.prepare import PreparedScan, fine_surfaces
from cgroup.rigid import invert
from cgroup.types import BoolArray, FloatArray, IndexArray
from cgroup.verification import Alignment, Place, align, places

_SPACINGS = (1 / 2, 1.0)
_BACKGROUND = 0.3  # of a point that should have been seen: scans have holes
_CHANCE = 10.0  # points that agree by chance
_EVIDENCE = 0.01
_RESIDUAL = 0.08
_MIDDLE, _STEEPNESS = 0.815, 60.0
_MIDDLE_UNSEEN = 0.72  # without a viewpoint, hidden points near the scene count as off it


@dataclass(frozen=True, eq=False)
class Sighting:
    """A model at a pose in a scene.

    Attributes
    ----------
    model, scene : PreparedScan
        With the same voxel.
    pose : (4,4) array of float64
        Maps the model into the scene.
    score : float
        Of the pose, by `cgroup.verification.verify`.
    evidence : int
        Number of matches that agree with the pose.
    seen : (5,) array of int64
        Number of the model's voxels at each `Place`.
    explained : (M,) array of bool
        Mask of the voxels of the scene on the model.
    """

    model: PreparedScan
    scene: PreparedScan
    pose: FloatArray
    score: float
    evidence: int
    seen: IndexArray
    explained: BoolArray
    threads: int | None

    @cached_property
    def refined(self) -> Alignment:
        """The pose refined at half the voxel."""
        surfaces = fine_surfaces(self.model, self.scene, _SPACINGS)
        return align(*surfaces, self.pose, threads=self.threads)

    @property
    def visible(self) -> float:
        """Share of the model's surface that the scene shows."""
        return float(self.seen[Place.ON] / self.seen.sum())

    def probability(self, free: BoolArray) -> float:
        """Return the probability of the pose, given the voxels of the scene that may belong to the model."""
        value = self._value(free)
        middle = _MIDDLE_UNSEEN if self.scene.viewpoint is None else _MIDDLE
        if value > middle:
            value -= _RESIDUAL * max(_misfit(self.refined) - 1, 0)
        return 1 / (1 + math.exp(min(-_STEEPNESS * (value - middle), 700)))

    def _value(self, free: BoolArray) -> float:
        """Return the free share of the voxels that should be seen, minus the share by chance."""
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
) -> Sighting:
    """Compare both surfaces under a pose."""
    seen = np.bincount(places(model.surface, scene.surface, pose, threads=threads), minlength=len(Place))
    explained = places(scene.surface, model.surface, invert(pose), threads=threads) == Place.ON
    return Sighting(model, scene, pose, score, evidence, seen, explained, threads)


def _misfit(aligned: Alignment) -> float:
    """Return the residuals over the deviation by noise and curvature; infinite without pairs."""
    if len(aligned.residuals) == 0:
        return math.inf
    expected = float(np.sqrt(np.mean(aligned.deviations**2)))
    return aligned.rmse / expected if expected > 0 else math.inf
