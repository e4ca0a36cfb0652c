"""Locate a scan in a map."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import count, islice
from typing import Any, NamedTuple

import numpy as np
from numpy.random import default_rng
from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.arrays import as_direction, as_place
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_choice, as_flag, as_instance, as_length, as_threads
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import StageClock, as_stage_function
from cgroup._runtime.workers import count_workers, work_side_by_side
from cgroup.errors import InputError
from cgroup.features import Cloud
from cgroup.features.voxels import choose_thinning
from cgroup.fronts.scan import as_viewpoint, mirror_image
from cgroup.maps import settings
from cgroup.maps.plan_view import Disk, find_layers
from cgroup.maps.prepared_map import Level, PreparedMap
from cgroup.registration import EFFORTS, DenseFront, Effort, PreparedScan, Registration, pairwise
from cgroup.rigid import apply
from cgroup.types import AnyCloud, FloatArray, IndexArray


@report_refused_memory()
@explain_wrong_calls
def locate(
    scan: Cloud | AnyCloud,
    place: PreparedMap,
    *,
    viewpoint: ArrayLike | None = None,
    view_direction: ArrayLike | None = None,
    axis: ArrayLike | None = None,
    near: ArrayLike | None = None,
    radius: float | None = None,
    effort: Effort = "normal",
    decoy: bool = False,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> list[Registration]:
    """Estimate the pose of a scan in a map.

    Places of the map are selected where walls and floors fit those of the scan as seen from above, and where
    descriptors are similar. The scan is registered to each place; one posterior covers all poses. Further
    parameters are as for `register`.

    Parameters
    ----------
    scan : PointCloud, Cloud, path or (N,3) array_like of float
        Whole cloud, in the unit of the map.
    place : PreparedMap
        Made by `prepare_map`.
    near : (3,) array_like of float, optional
        Approximate position of the origin of the scan's frame in the map.
    radius : float, optional
        Largest error of `near`; by default the scan's own radius.
    decoy : bool
        Also locate the mirror image of the scan. `decoy_probability` is then that of its best place in the
        whole map, otherwise that of its best pose at the places of the scan. The mirror image takes as long
        as a scan that is not in the map: about ten times as long as one that is.

    Returns
    -------
    list of Registration
        The best first, then the poses that share the probability with it; in a repeating map none is `ok`.
        Empty if there is not even a guess.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.scenes import locate, prepare_map
    >>> pair = standin_pair()
    >>> place = prepare_map(pair.target)
    >>> [found.ok for found in locate(pair.source, place)]
    [True]
    """
    as_instance("place", place, PreparedMap)
    as_choice("effort", effort, EFFORTS)
    direction = None if axis is None else as_direction("axis", axis, "(0, 0, 1)")
    around, decoy = as_disk(near, radius), as_flag("decoy", decoy)
    clock = StageClock(as_stage_function(progress))
    given = pairwise.as_given("scan", scan, as_viewpoint(viewpoint, view_direction), or_stored=True)
    search = pairwise.Search("lc", {}, direction, effort, 1, clock)
    clock.start("voxels")
    given = given._replace(scan=given.whole)  # prepared anew, with the map's voxels
    size = choose_thinning(given.whole.cloud, voxels=settings.SCAN_VOXELS, threads=threads)
    levels = place.level_at(size), place.level_at(size, finer=1)
    threads = as_threads(threads)
    best, source = _find(given, levels, search, around, threads)
    if decoy:
        image = pairwise.Given("scan", *mirror_image(source.scan, source.viewpoint, direction))
        mirrored, _ = _find(image, levels, search, around, threads)
        reached = mirrored[0][0].probability if mirrored else 0.0
        best = [(replace(found, decoy=reached), where) for found, where in best]
    judged = [(found, pairwise.judge(found, source, where, direction)) for found, where in best]
    return [pairwise.registration_of(found, judgement, clock.stop()) for found, judgement in judged]


def _find(
    given: pairwise.Given,
    levels: tuple[Level, Level],
    search: pairwise.Search,
    around: Disk | None,
    threads: int | None,
) -> tuple[list[tuple[pairwise.Found, PreparedScan]], PreparedScan]:
    """Return the best poses of a scan, each with its place, and the prepared scan."""

    def look(level: Level) -> _Locating:
        shared = pairwise.Preparation(level.voxel, DenseFront(), threads)
        return _Locating(shared.finish(given, by_frames=True), level, search, around)

    fitting, finer = levels
    locating = look(fitting)
    best = locating.run("low")
    if not best or not best[0][0].is_accepted:
        locating = locating if finer is fitting else look(finer)
        found = locating.run(search.effort)
        if found and (not best or found[0][0].probability > best[0][0].probability):
            best = found
    return best, locating.source


def as_disk(near: ArrayLike | None, radius: float | None) -> Disk | None:
    """Check where to search; the radius is NaN by default."""
    if near is None:
        if radius is not None:
            raise InputError("radius", f"{radius}, but no place", "give `near`, too")
        return None
    within = np.nan if radius is None else as_length("radius", radius)
    return Disk(np.array(as_place("near", near)), within)


class _Place(NamedTuple):
    cells: IndexArray
    proposed: FloatArray | None


class _Candidate(NamedTuple):
    pose: FloatArray
    case: pairwise.Case
    found: pairwise.Found
    place: PreparedScan


class _Locating:
    def __init__(
        self, source: PreparedScan, level: Level, search: pairwise.Search, around: Disk | None
    ) -> None:
        self.source, self._level, self._search = source, level, search
        points = source.points
        away = np.linalg.norm(points - source.scan.centroid, axis=1)
        self._radius = float(np.quantile(away, settings.WITHIN))
        self._candidates: list[_Candidate] = []
        self._chosen: list[_Place] = []
        self._choosing = self._places()
        self._origins = around
        self._cells = np.arange(len(level.cells))
        self._region: pairwise.Region | None = None  # of the scan's origin
        if around is not None:
            radius = self._radius if np.isnan(around.radius) else around.radius
            self._origins = around._replace(radius=radius)
            self._region = pairwise.Region(around.middle, radius + settings.SLACK * source.voxel)
            reach = float(np.quantile(np.linalg.norm(points, axis=1), settings.WITHIN))
            self._cells = level.around(around.middle, radius + reach + settings.CELL * level.voxel)

    def run(self, effort: pairwise.Depth) -> list[tuple[pairwise.Found, PreparedScan]]:
        """Register the scan to the most similar places until a pose is accepted."""
        search, workers = replace(self._search, effort=effort), count_workers(self.source.threads)
        done: list[tuple[pairwise.Found, PreparedScan]] = []
        for tried in count(0, settings.AT_A_TIME):
            search.clock.start("places")
            self._chosen += islice(self._choosing, max(tried + settings.AT_A_TIME - len(self._chosen), 0))
            some = self._chosen[tried : tried + settings.AT_A_TIME]
            if not some:
                break
            search.clock.start("registration")
            each = max(workers // len(some), 1)
            search = replace(search, threads=each)
            for place, found in work_side_by_side(some, partial(self._register, search), workers):
                if found is not None:
                    poses = zip([found.pose, *found.places[1:]], found.cases, strict=True)
                    self._candidates += [_Candidate(*each, found, place) for each in poses]
            done = self._weigh()
            is_late = tried + settings.AT_A_TIME >= settings.ENOUGH
            if done and (done[0][0].is_accepted if is_late else done[0][0].probability >= settings.SURE):
                break
        return done

    def _places(self) -> Iterator[_Place]:
        """Yield places of the map as candidates for the scan."""
        if len(self._cells) == 0:
            return
        seen = self._poses_from_above()
        if self._level.count(self._cells) <= settings.WHOLE:
            yield _Place(self._cells, np.concatenate(seen) if seen else None)
            return
        middle = self.source.scan.centroid[None]
        for poses in seen:
            yield _Place(self._cells_around(apply(poses[0], middle)[0]), poses)
        yield from self._places_alike()

    def _poses_from_above(self) -> list[FloatArray]:
        """Return poses that align walls and floors of the scan with those of the map in plan view."""
        axis, source = self._search.axis, self.source
        plan = self._level.plan(axis)
        layers = find_layers(source.points, source.normals, axis)
        if plan is None or layers is None:
            return []
        region = self._region

        def may_be(poses: FloatArray) -> bool:
            if region is None:
                return True
            away = np.linalg.norm(poses[:, :3, 3] - region.center, axis=1)
            return bool((away <= region.radius).any())

        seen = plan.propose(layers, self._origins, source.threads)
        return list(islice(filter(may_be, seen), settings.FROM_ABOVE))

    def _places_alike(self) -> Iterator[_Place]:
        """Yield separate places with descriptors similar to those of the scan."""
        described = self.source.described
        rows = default_rng(0).permutation(len(described))
        away = np.linalg.norm(described.points[rows] - described.centroid, axis=1)
        most = int(np.clip(settings.COMPARISONS / len(self._level.voxels), *settings.COMPARED))
        some = rows[away <= self._radius][:most]
        unlike = self._level.compare(described.descriptors[some], settings.COMPARED_WITHIN * self._radius)
        left = np.full_like(unlike, np.inf)
        left[self._cells] = unlike[self._cells]
        for _ in range(settings.ALIKE_PLACES):
            if not np.isfinite(left).any():
                return
            middle = self._level.cells[int(np.argmin(left))]
            left[self._level.around(middle, settings.PLACES_APART * self._radius)] = np.inf
            yield _Place(self._cells_around(middle), None)

    def _cells_around(self, middle: FloatArray) -> IndexArray:
        return self._level.around(middle, settings.AROUND * self._radius)

    def _register(
        self, search: pairwise.Search, place: _Place, stop_with_the_others: Callable[[], None]
    ) -> tuple[PreparedScan, pairwise.Found | None]:
        stop_with_the_others()
        clock = StageClock(lambda _: stop_with_the_others())
        search = replace(search, clock=clock, proposed=place.proposed, region=self._region)
        target = self._level.crop(place.cells, search.threads)
        return target, search.run(self.source, target)

    def _weigh(self) -> list[tuple[pairwise.Found, PreparedScan]]:
        """Divide the probability among the poses of all places; return the best first."""
        ranked = sorted(self._candidates, key=lambda candidate: -_core.weigh(candidate.case))
        if not ranked:
            return []
        poses = np.array([candidate.pose for candidate in ranked])
        apart = pairwise.choose_apart(poses, self.source.scan.centroid, self.source.voxel)
        best, *rivals = (ranked[row] for row in apart[: 1 + settings.RIVALS])
        # What chance reaches in any of the places.
        reached = max(candidate.case[-1] for candidate in self._candidates)
        cases = [(*candidate.case[:-1], reached) for candidate in (best, *rivals)]
        chance, shares = pairwise.share_probability(cases)
        chance = pairwise.bound_by_motions(chance, best.found.motions)
        chance = pairwise.bound_by_size(chance, self.source, best.place) * best.found.scale_factor
        alike = np.flatnonzero(pairwise.are_alternatives(chance, shares)).tolist()
        reached_by_decoys = [one.found.decoy for one in self._candidates if one.found.decoy is not None]
        decoy = max(reached_by_decoys, default=None)
        places = [(best, chance), *((rivals[row], chance * min(float(shares[row]), 1.0)) for row in alike)]
        done: list[tuple[pairwise.Found, PreparedScan]] = []
        for one, probability in places:
            others = np.reshape([other.pose for other, _ in places if other is not one], (-1, 4, 4))
            found = replace(self._refined(one), probability=probability, alternatives=others, decoy=decoy)
            done.append((found, one.place))
        return done

    def _refined(self, one: _Candidate) -> pairwise.Found:
        """Return the result of a candidate; a rival was not refined with all samples yet."""
        if one.pose is one.found.pose:
            return one.found
        found = pairwise.confirm_pose(self.source, one.place, one.pose, self.source.threads)
        return replace(found or replace(one.found, pose=one.pose), matches=one.found.matches)
