"""Search for the pose of two prepared scans, in the compiled core."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from cgroup import _core
from cgroup._checks.values import run_options
from cgroup._runtime.progress import StageClock
from cgroup.features import ORIGIN
from cgroup.fronts.matching import frame_poses, match_both_ways, propose_poses, take_matches
from cgroup.fronts.paper_front import PaperFront, correspond_by
from cgroup.registration.judge import Found
from cgroup.registration.own import Nearby, describe_voxels
from cgroup.registration.prepare import UNIT, PreparedScan, refused
from cgroup.registration.result import SEARCH
from cgroup.types import Correspondences, FloatArray, RealArray
from cgroup.types.fields import Fields, own_correspondences

Effort: TypeAlias = Literal["low", "normal", "high"]
Depth: TypeAlias = Literal["first", "low", "normal", "high"]  # "first": at the coarsest voxels only
EFFORTS: tuple[Effort, ...] = ("low", "normal", "high")
MAX_MATCHES = 1 << 32  # bytes of the matches of two scans


class Region(NamedTuple):
    """A ball in which the moved origin of the source has to lie."""

    center: FloatArray
    radius: float


class Options(NamedTuple):
    """Options of a search, as the compiled core reads them."""

    axis: list[float] | None
    effort: str
    proposed: FloatArray
    own: bool
    nearby: tuple[FloatArray, float, float] | None
    region: tuple[list[float], float] | None


@dataclass(frozen=True, eq=False)
class Search:
    """Options of a search for a pose."""

    method: str
    options: Mapping[str, Any]
    axis: FloatArray | None
    effort: Depth
    threads: int | None
    clock: StageClock
    front: PaperFront | None = None
    proposed: FloatArray | None = None
    matches: Correspondences | None = None
    descriptors: tuple[RealArray, RealArray] | None = None
    nearby: Nearby | None = None
    region: Region | None = None

    def run(self, source: PreparedScan, target: PreparedScan) -> Found | None:
        """Search for the pose; None if none can be proposed."""
        proposed = np.empty((0, 4, 4)) if self.proposed is None else self.proposed
        own = None if self.nearby is not None else self._propose(source, target)
        if own is not None:
            proposed = np.concatenate([proposed, own[1]])
        self.clock.start(SEARCH)
        nearby, region = self.nearby, self.region
        options = Options(
            None if self.axis is None else self.axis.tolist(),
            self.effort,
            np.ascontiguousarray(proposed),
            own is not None,
            None if nearby is None else (nearby.pose[None], nearby.angle, nearby.radius),
            None if region is None else (region.center.tolist(), region.radius),
        )
        found, refusal = _core.register(
            source.core, target.core, options, run_options(self.threads, max_memory=MAX_MATCHES)
        )
        if refusal is not None:
            side = (source, target)[refusal[0]]
            raise refused(side.scan, side.voxel, refusal[1])
        return found and found_of(found, source, self.threads, own and own[0])

    def _propose(
        self, source: PreparedScan, target: PreparedScan
    ) -> tuple[Correspondences, FloatArray] | None:
        """Return matches and their poses, unless the compiled core proposes them."""
        if self.matches is not None:
            matches = self.matches
            return matches, np.concatenate([self._group(matches), frame_poses(matches)])
        if self.front is not None:
            places = source.viewpoint or ORIGIN, target.viewpoint or ORIGIN
            clouds = source.scan, target.scan
            matches = correspond_by(self.front, *clouds, places, self.threads, self.clock.start)
            return matches, self._group(matches)
        if self.descriptors is None and self.method == "lc" and not self.options:
            return None
        self.clock.start("matching")
        one, other = source.described, target.described
        if self.descriptors is not None:
            one, other = map(describe_voxels, (source, target), self.descriptors)
        matches, is_mutual = match_both_ways(one, other, 1, self.threads)
        mutual = take_matches(matches, is_mutual)
        groups = (
            [self._group(mutual)] if self.effort == "low" else [self._group(mutual), self._group(matches)]
        )
        return matches, np.concatenate([*groups, frame_poses(mutual)])

    def _group(self, matches: Correspondences) -> FloatArray:
        self.clock.start("grouping")
        return propose_poses(matches, self.method, self.threads, **self.options)


def found_of(
    found: _core.Registered,
    source: PreparedScan,
    threads: int | None,
    matches: Correspondences | None = None,
) -> Found:
    """Return the result of the compiled core, with its own matches unless others are given."""
    level, other_level = found.levels
    if matches is None:
        one, other, similarity, ratio, source_lrf, target_lrf = found.matches
        centroid = np.array(source.scan.centroid)
        fields = Fields(
            one,
            other,
            similarity=similarity,
            ratio=ratio,
            source_lrf=source_lrf,
            target_lrf=target_lrf,
            resolution=UNIT * level.voxel,
            source_centroid=centroid,
        )
        matches = own_correspondences(fields)
    fitness, target_fitness = found.fitness
    return Found(
        found.pose,
        found.probability,
        found.alternatives,
        fitness,
        target_fitness,
        found.rmse,
        found.open_motion,
        matches,
        level.points,
        source.voxel,
        partial(_core.covariance, found, run_options(threads)),
        lambda poses: level.overlap(other_level, poses, run_options(threads)),
        motions=found.motions,
        cases=found.cases,
        shares=found.shares,
        places=found.places,
        better_scale=found.better_scale,
        scale_factor=found.scale_factor,
        decoy=found.decoy,
        seconds=dict(found.seconds),
    )


def confirm_pose(
    source: PreparedScan, target: PreparedScan, pose: FloatArray, threads: int | None
) -> Found | None:
    """Refine a pose on the fine surfaces, and estimate its probability alone; None without overlap."""
    found = source.level.confirm(target.level, np.ascontiguousarray(pose)[None], run_options(threads))
    return None if found is None else found_of(found, source, threads)
