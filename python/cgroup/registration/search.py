"""From two prepared scans to the pose that their surfaces confirm: propose, verify, refine, judge."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from cgroup.group import group
from cgroup.registration.judgement import ACCEPTED, SURE, probability, rank
from cgroup.registration.matching import match_both_ways, take_matches, without_frames
from cgroup.registration.poses import frame_poses, group_poses, is_upright, keep_upright
from cgroup.registration.prepared import fine_surfaces
from cgroup.verification import align, verify
from cgroup.verification.alignment import align_each

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cgroup._runtime.progress import StageClock
    from cgroup.registration.prepared import PreparedScan
    from cgroup.types import Correspondences, FloatArray
    from cgroup.verification import Alignment, Verification

Effort: TypeAlias = Literal["low", "normal", "high"]
EFFORTS: tuple[Effort, ...] = ("low", "normal", "high")

FINALISTS = 8
"""Verified poses that are refined on the fine surfaces."""

FIRST_SAMPLES = 500
"""Samples of either surface that they are refined with; the best one then gets all."""

_FINER = 2**-0.5
_FINER_NEIGHBORS = 3


@dataclass(frozen=True, eq=False)
class Found:
    """The best pose of a search, and what speaks for it.

    Attributes
    ----------
    refined : Alignment
        The best one, refined on the fine surfaces.
    poses : (k,4,4) array of float64
        The finalists, refined too, best first.
    values : (k,) array of float64
        What they are ranked by.
    probability : float
        That it is right.
    fitness : float
        Share of the source's surface that lies on the target's.
    matches : Correspondences
        Every match of the search.
    source, target : PreparedScan
        The scans, at the voxel where it was found.
    """

    refined: Alignment
    poses: FloatArray
    values: FloatArray
    probability: float
    fitness: float
    matches: Correspondences
    source: PreparedScan
    target: PreparedScan


@dataclass(frozen=True, eq=False)
class Search:
    """How a pose is searched for."""

    method: str
    options: Mapping[str, Any]
    axis: FloatArray | None
    effort: Effort
    threads: int | None
    clock: StageClock

    def run(self, source: PreparedScan, target: PreparedScan) -> Found | None:
        """Search with mutual matches, then with all, then on finer voxels, until the pose is sure."""
        best = self._search_voxels(source, target, 1)
        if self.effort == "high" and (best is None or best.probability < ACCEPTED):
            finer = source.resized(_FINER, self.clock.start), target.resized(_FINER, self.clock.start)
            best = _better(best, self._search_voxels(*finer, _FINER_NEIGHBORS))
        return self._refine(best)

    def confirm(
        self, source: PreparedScan, target: PreparedScan, matches: Correspondences, poses: FloatArray
    ) -> Found | None:
        """Search among poses that come from elsewhere, with matches of one's own."""
        self.clock.start("matching")
        voxel_matches, is_mutual = match_both_ways(source.described, target.described, 1, self.threads)
        verified = self._verify(source, target, take_matches(voxel_matches, is_mutual), poses)
        return self._refine(self._judge(source, target, matches, verified))

    def _search_voxels(self, source: PreparedScan, target: PreparedScan, k: int) -> Found | None:
        self.clock.start("matching")
        matches, is_mutual = match_both_ways(source.described, target.described, k, self.threads)
        mutual = take_matches(matches, is_mutual)
        poses = np.concatenate([self._propose(mutual), frame_poses(mutual)])
        verified = self._verify(source, target, mutual, poses)
        best = self._judge(source, target, matches, verified)
        if self.effort == "low" or (best is not None and best.probability >= SURE):
            return best
        poses = self._propose(matches)
        if verified is not None:
            poses = np.concatenate([verified.poses, poses])
        # Not the more probable of the two: the second has seen the rivals of the first.
        return self._judge(source, target, matches, self._verify(source, target, mutual, poses)) or best

    def _propose(self, matches: Correspondences) -> FloatArray:
        self.clock.start("grouping")
        chosen = without_frames(matches) if self.method == "lc" else matches
        return group_poses(group(chosen, self.method, threads=self.threads, **self.options))

    def _verify(
        self, source: PreparedScan, target: PreparedScan, mutual: Correspondences, poses: FloatArray
    ) -> Verification | None:
        """Verify the poses that keep the axis; None where no pose does, before or after."""
        self.clock.start("verification")
        surfaces = source.surface, target.surface
        upright = keep_upright(poses, self.axis)
        if len(upright) == 0:
            return None
        verified = verify(*surfaces, upright, matches=mutual, threads=self.threads)
        upright = keep_upright(verified.poses, self.axis)
        if len(upright) == 0:
            return None
        if len(upright) == len(verified.poses):
            return verified
        return verify(*surfaces, upright, matches=mutual, threads=self.threads)

    def _judge(
        self,
        source: PreparedScan,
        target: PreparedScan,
        matches: Correspondences,
        verified: Verification | None,
    ) -> Found | None:
        """Refine the finalists on the fine surfaces, choose one, and say how likely it is right."""
        if verified is None:
            return None
        self.clock.start("refinement")
        surfaces, voxel = fine_surfaces(source, target), source.voxel
        finalists = verified.poses[:FINALISTS]
        aligned = align_each(*surfaces, finalists, FIRST_SAMPLES, self.threads)
        kept = [row for row, found in enumerate(aligned) if is_upright(found.T_target_source, self.axis)]
        if not kept:
            return None
        aligned = [aligned[row] for row in kept]
        poses = np.array([found.T_target_source for found in aligned])
        values = rank(verified.scores[kept], verified.evidence[kept], aligned, voxel)
        chance = probability(values, poses, source.described.centroid, voxel)
        order = np.argsort(-values)
        best = aligned[order[0]]
        return Found(best, poses[order], values[order], chance, verified.fitness, matches, source, target)

    def _refine(self, found: Found | None) -> Found | None:
        """Refine the best pose once more, with all samples of the fine surfaces, and measure its overlap."""
        if found is None:
            return None
        surfaces = fine_surfaces(found.source, found.target)
        refined = align(*surfaces, found.refined.T_target_source, threads=self.threads)
        if not is_upright(refined.T_target_source, self.axis):
            refined = found.refined
        pose = refined.T_target_source
        shared = verify(found.source.surface, found.target.surface, pose, threads=self.threads)
        return replace(found, refined=refined, fitness=shared.fitness)


def _better(one: Found | None, other: Found | None) -> Found | None:
    """Return the more probable of two; the first where they are equal."""
    if one is None or other is None:
        return other if one is None else one
    return other if other.probability > one.probability else one
