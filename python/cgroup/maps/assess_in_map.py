"""Check a pose of a scan in a map, several times a second."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_instance, as_threads
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import StageClock, as_stage_function
from cgroup.errors import NoConsensusError
from cgroup.features import Cloud
from cgroup.features.voxels import choose_thinning
from cgroup.maps import settings
from cgroup.maps.prepared_map import PreparedMap
from cgroup.registration import DenseFront, Registration, pairwise
from cgroup.rigid import apply, check_rigid
from cgroup.types import AnyCloud


@report_refused_memory()
@explain_wrong_calls
def assess_in_map(
    scan: Cloud | AnyCloud,
    place: PreparedMap,
    T_map_scan: ArrayLike,
    *,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Registration:
    """Return the probability and the covariance of a pose of a scan in a map.

    The pose is refined where it is, and compared with chance only: other places of the map are not searched,
    so of two that look the same either is accepted (`locate` compares them). As for `assess`, half of the
    probability is left if refining moves the scan by 0.4 voxel. Further parameters are as for `locate`, and
    as for `register`.

    Parameters
    ----------
    T_map_scan : (4,4) array_like of float
        Pose of the scan in the map, such as that of a tracker.

    Returns
    -------
    Registration
        Of the given pose; the first of its `alternatives` is the refined one. The reason for a refusal is the
        first of the `notes`.

    Raises
    ------
    NoConsensusError
        If the scan does not meet the map under the pose.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.scenes import assess_in_map, prepare_map
    >>> pair = standin_pair()
    >>> assess_in_map(pair.source, prepare_map(pair.target), pair.T_target_source).ok
    True
    """
    as_instance("place", place, PreparedMap)
    clock, pose = StageClock(as_stage_function(progress)), check_rigid(T_map_scan, "T_map_scan")
    clock.start("voxels")
    given = pairwise.as_given("scan", scan)
    given = given._replace(scan=given.whole)  # prepared anew, with the map's voxels
    size = choose_thinning(given.whole.cloud, voxels=settings.SCAN_VOXELS, threads=threads)
    level = place.level_at(size)
    shared = pairwise.Preparation(level.voxel, DenseFront(), as_threads(threads))
    source = shared.finish(given, by_frames=True)
    moved = apply(pose, source.points)
    middle = moved.mean(axis=0)
    radius = np.linalg.norm(moved - middle, axis=1).max() + settings.CELL * level.voxel
    cells = level.around(middle, float(radius))
    clock.start("refinement")
    if level.count(cells) < pairwise.LEAST_VOXELS:
        raise NoConsensusError("the map has no surface where the pose puts the scan")
    target = level.crop(cells, threads)
    found = pairwise.confirm_pose(source, target, pose, threads)
    if found is None:
        raise NoConsensusError("the scan does not overlap the map under the pose")
    off = float(np.sqrt(((apply(found.pose, source.points) - moved) ** 2).sum(axis=1).mean()))
    chance = found.probability * pairwise.share_left(off / level.voxel)
    judgement = pairwise.judge(replace(found, probability=chance), source, target)
    notes = (judgement.reason, *judgement.notes) if judgement.reason else judgement.notes
    done = pairwise.registration_of(found, judgement, clock.stop())
    return replace(done, T_target_source=pose, notes=notes, alternatives=found.pose[None])
