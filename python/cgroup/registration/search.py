"""Search for the pose of two prepared scans: propose, verify on the surfaces, refine, rank."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from cgroup._runtime.progress import StageClock
from cgroup._runtime.workers import cached_property
from cgroup.errors import InputError
from cgroup.features import ORIGIN
from cgroup.registration.covariance import count_open_motions
from cgroup.registration.evidence import gather
from cgroup.registration.judge import (
    Case,
    Found,
    are_alternatives,
    bound_by_motions,
    bound_by_size,
    choose_apart,
    is_accepted,
    is_sure,
    misfit,
    rank,
    share_probability,
    weigh,
)
from cgroup.registration.matching import frame_poses, match_both_ways, propose_poses, take_matches
from cgroup.registration.nearby import Nearby
from cgroup.registration.own import describe_voxels, match_nothing
from cgroup.registration.paper_front import PaperFront, correspond_by
from cgroup.registration.parts import propose_by_parts
from cgroup.registration.prepare import FEW_POINTS, PreparedScan, fine_surfaces
from cgroup.registration.rivals import propose_rivals
from cgroup.registration.similarity import compare_scales
from cgroup.rigid import invert
from cgroup.types import BoolArray, Correspondences, FloatArray, RealArray
from cgroup.verification import Alignment, Verification, align, verify
from cgroup.verification.alignment import align_each

Effort: TypeAlias = Literal["low", "normal", "high"]
EFFORTS: tuple[Effort, ...] = ("low", "normal", "high")
FINALISTS = 8  # number of verified poses that are refined on the fine surfaces
NEARBY_FINALISTS = 3  # the same near a rough pose
RIVALS = 6  # number of rivals of the best pose, and of those that are searched for
FIRST_SAMPLES = 500  # samples of either surface for their refinement; the best one then gets all
MAX_TILT = 10.0  # degrees by which a pose may tilt an axis that both clouds share
# Voxels, in those before, and the neighbours that each is matched with: where more effort is asked for, and
# for clouds of few points, which leave it to chance at which voxel the pose is found
_FINER, _OF_FEW = ((2**-0.5, 3),), ((1.25, 1), (0.8, 1))


@dataclass(frozen=True, eq=False)
class Finalist:
    """A refined pose of two scans, its score, the number of agreeing matches, and its rank value."""

    source: PreparedScan
    target: PreparedScan
    found: Alignment
    score: float
    support: int
    value: float

    @cached_property
    def case(self) -> Case:
        """Evidence for the pose."""
        evidence = gather(self.source, self.target, self.found.T_target_source)
        return Case(self.score, self.support, misfit(self.found, self.source.voxel), evidence)


@dataclass(frozen=True, eq=False)
class Search:
    """Options of a search for a pose."""

    method: str
    options: Mapping[str, Any]
    axis: FloatArray | None
    effort: Effort
    threads: int | None
    clock: StageClock
    front: PaperFront | None = None
    proposed: FloatArray | None = None
    matches: Correspondences | None = None
    descriptors: tuple[RealArray, RealArray] | None = None
    nearby: Nearby | None = None
    allows: Callable[[FloatArray], BoolArray] | None = None

    def run(self, source: PreparedScan, target: PreparedScan) -> Found | None:
        """Search for the pose, independent of the roles of the two scans."""
        if self.nearby is not None:
            return self.finish(compare_scales(self._search_nearby(source, target, self.nearby)))
        if self.matches is not None:
            return self.finish(compare_scales(self._search_matches(source, target, self.matches)))
        if _order(source) <= _order(target):
            return self.finish(compare_scales(self._search(source, target)))
        found = compare_scales(self._turned()._search(target, source))  # noqa: SLF001 - its own
        return self.finish(None if found is None else found.turned())

    def _turned(self) -> Search:
        proposed = None if self.proposed is None else np.linalg.inv(self.proposed)
        descriptors = None if self.descriptors is None else self.descriptors[::-1]
        allows = self.allows
        turned = None if allows is None else lambda poses: allows(np.linalg.inv(poses))
        return replace(self, proposed=proposed, descriptors=descriptors, allows=turned)

    def _search(self, source: PreparedScan, target: PreparedScan) -> Found | None:
        """Search with mutual matches, then with all, then at other voxels, until a pose is accepted."""
        if self.front is not None:
            places = source.viewpoint or ORIGIN, target.viewpoint or ORIGIN
            clouds = source.scan, target.scan
            matches = correspond_by(self.front, *clouds, places, self.threads, self.clock.start)
            return self._search_matches(source, target, matches)
        best = self._search_voxels(source, target, 1)
        is_small = min(len(scan.scan.cloud) for scan in (source, target)) < FEW_POINTS
        levels = _OF_FEW if is_small and self.effort != "low" else ()
        for factor, k in (*levels, *(_FINER if self.effort == "high" else ())):
            if best is not None and is_accepted(best.probability):
                break
            with suppress(InputError):  # if the points are too sparse for finer voxels
                other = source.resized(factor, self.clock.start), target.resized(factor, self.clock.start)
                best = _better(best, self._search_voxels(*other, k))
        return best

    def _search_matches(
        self, source: PreparedScan, target: PreparedScan, matches: Correspondences
    ) -> Found | None:
        """Search among the poses of a group of given matches."""
        poses = self._propose(matches)
        if self.matches is not None:
            poses = np.concatenate([poses, frame_poses(matches)])
        mutual = self._match_voxels(source, target)
        verified = self._verify(source, target, mutual, poses)
        return self._rank(source, target, matches, mutual, verified)

    def _search_nearby(self, source: PreparedScan, target: PreparedScan, nearby: Nearby) -> Found | None:
        """Search among the poses near a rough pose, on the surfaces only."""
        self.clock.start("verification")
        poses = nearby.propose(source, target, self.threads)
        verified = self._verify(source, target, None, poses)
        aligned = self._align(source, target, verified, NEARBY_FINALISTS)
        finalists = [finalist for finalist in aligned if len(finalist.found.residuals)]
        return self._weigh(source, target, match_nothing(source), finalists) if finalists else None

    def _match_voxels(self, source: PreparedScan, target: PreparedScan) -> Correspondences:
        """Return mutual matches of voxels by FPFH, as evidence for given poses."""
        self.clock.start("matching")
        return take_matches(*match_both_ways(source.described, target.described, 1, self.threads))

    def _search_voxels(self, source: PreparedScan, target: PreparedScan, k: int) -> Found | None:
        """Search among the poses from matches of voxels, and other proposed poses."""
        self.clock.start("matching")
        one, other = source.described, target.described
        if self.descriptors is not None:
            one, other = map(describe_voxels, (source, target), self.descriptors)
        matches, is_mutual = match_both_ways(one, other, k, self.threads)
        mutual = take_matches(matches, is_mutual)
        poses = np.concatenate([self._propose(mutual), frame_poses(mutual)])
        if self.proposed is not None:
            poses = np.concatenate([self.proposed, poses])
        if self.descriptors is not None:
            mutual = self._match_voxels(source, target)
        verified = self._verify(source, target, mutual, poses)
        best = self._rank(source, target, matches, mutual, verified)
        if self.effort == "low" or (best is not None and is_sure(best.probability)):
            return best
        poses = np.concatenate([self._propose(matches), propose_by_parts(source, target, self.threads)])
        if verified is not None:
            poses = np.concatenate([verified.poses, poses])
        # Not the more probable of the two: the second has seen the rivals of the first.
        verified = self._verify(source, target, mutual, poses)
        return self._rank(source, target, matches, mutual, verified) or best

    def _propose(self, matches: Correspondences) -> FloatArray:
        self.clock.start("grouping")
        return propose_poses(matches, self.method, self.threads, **self.options)

    def _verify(
        self, source: PreparedScan, target: PreparedScan, mutual: Correspondences | None, poses: FloatArray
    ) -> Verification | None:
        """Verify the allowed poses; None if none is allowed or none survives."""
        self.clock.start("verification")
        surfaces = source.surface, target.surface
        allowed = self._keep_allowed(poses, source)
        if len(allowed) == 0:
            return None
        verified = verify(*surfaces, allowed, matches=mutual, threads=self.threads)
        allowed = self._keep_allowed(verified.poses, source)
        if len(allowed) == 0:
            return None
        if len(allowed) == len(verified.poses):
            return verified
        return verify(*surfaces, allowed, matches=mutual, threads=self.threads)

    def _keep_allowed(self, poses: FloatArray, source: PreparedScan) -> FloatArray:
        """Drop the poses that tilt the axis, are too far from a rough pose, or are not allowed."""
        kept = keep_upright(poses, self.axis)
        if self.allows is not None:
            kept = kept[self.allows(kept)]
        return kept if self.nearby is None else kept[self.nearby.holds(kept, source)]

    def _is_allowed(self, pose: FloatArray, source: PreparedScan) -> bool:
        return len(self._keep_allowed(pose[None], source)) == 1

    def _rank(
        self,
        source: PreparedScan,
        target: PreparedScan,
        matches: Correspondences,
        mutual: Correspondences,
        verified: Verification | None,
    ) -> Found | None:
        """Refine the finalists on the fine surfaces, select one, and estimate its probability."""
        finalists = self._align(source, target, verified, FINALISTS)
        if not finalists:
            return None
        found = self._weigh(source, target, matches, finalists)
        if is_accepted(found.probability):
            best = found.refined
            poses = propose_rivals(source, target, best.T_target_source, best.information)
            finalists += self._align(source, target, self._verify(source, target, mutual, poses), RIVALS)
            found = self._weigh(source, target, matches, finalists)
        return found

    def _align(
        self, source: PreparedScan, target: PreparedScan, verified: Verification | None, most: int
    ) -> list[Finalist]:
        if verified is None:
            return []
        self.clock.start("refinement")
        surfaces = fine_surfaces(source, target)
        aligned = align_each(*surfaces, verified.poses[:most], FIRST_SAMPLES, self.threads)
        values = rank(verified.scores, verified.evidence, aligned, source.voxel)
        return [
            Finalist(source, target, found, score, support, value)
            for found, score, support, value in zip(
                aligned, verified.scores.tolist(), verified.evidence.tolist(), values.tolist(), strict=False
            )
            if self._is_allowed(found.T_target_source, source)
        ]

    def _weigh(
        self,
        source: PreparedScan,
        target: PreparedScan,
        matches: Correspondences,
        finalists: list[Finalist],
    ) -> Found:
        """Compare the best of the finalists with its rivals."""
        ranked = sorted(finalists, key=lambda finalist: -finalist.value)
        poses = np.array([finalist.found.T_target_source for finalist in ranked])
        rows = choose_apart(poses, source.scan.centroid, source.voxel)[: 1 + RIVALS]
        rows.sort(key=lambda row: -weigh(ranked[row].case))
        cases = [ranked[row].case for row in rows]
        chance, shares = share_probability(cases[0], cases[1:])
        best = ranked[rows[0]].found
        motions = count_open_motions(best, source, target)
        chance = bound_by_size(bound_by_motions(chance, motions), source, target)
        return Found(
            best,
            poses[rows[1:]][are_alternatives(chance, shares)],
            chance,
            0.0,
            matches,
            source,
            target,
            motions=motions,
            cases=tuple(cases),
            places=poses[rows],
        )

    def finish(self, found: Found | None) -> Found | None:
        """Refine the best pose once more, with all samples of the fine surfaces, and measure the overlap."""
        if found is None:
            return None
        surfaces = fine_surfaces(found.source, found.target)
        refined = align(*surfaces, found.refined.T_target_source, threads=self.threads)
        if not self._is_allowed(refined.T_target_source, found.source):
            refined = found.refined
        if found.motions == 0:
            refined = replace(refined, open_motion=None)
        pose = refined.T_target_source
        shares = [
            verify(one.surface, other.surface, way, threads=self.threads).fitness
            for one, other, way in (
                (found.source, found.target, pose),
                (found.target, found.source, invert(pose)),
            )
        ]
        return replace(found, refined=refined, fitness=shares[0], target_fitness=shares[1])


def _order(scan: PreparedScan) -> tuple[float, ...]:
    """Return a sort key of a scan in any frame: its size, then the distance of a voxel from the mean."""
    return len(scan), float(np.linalg.norm(scan.voxels.points[0] - scan.scan.centroid))


def _better(one: Found | None, other: Found | None) -> Found | None:
    if one is None or other is None:
        return other if one is None else one
    return other if other.probability > one.probability else one


def keep_upright(poses: FloatArray, axis: FloatArray | None) -> FloatArray:
    """Drop the poses that tilt an axis by more than `MAX_TILT` degrees."""
    if axis is None:
        return poses
    cosines = np.einsum("i,nij,j->n", axis, poses[:, :3, :3], axis)
    return poses[cosines >= np.cos(np.radians(MAX_TILT))]
