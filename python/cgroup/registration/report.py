"""What a search found, put into the words of a result."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup._runtime.run import Run
from cgroup.registration.freedom import MOST_OPEN_MOTIONS, count_open_motions
from cgroup.registration.judgement import ACCEPTED
from cgroup.registration.result import Registration
from cgroup.rigid import apply
from cgroup.types import Grouping

if TYPE_CHECKING:
    from cgroup.registration.prepared import PreparedScan
    from cgroup.registration.search import Found
    from cgroup.types import Correspondences, FloatArray

GROUP_WITHIN = 2.0
"""Residual in voxels within which a match belongs to the verified group."""

_AS_GOOD = 0.7
_SIZES_DIFFER = 1.5


def registration_of(found: Found, seconds: dict[str, float]) -> Registration:
    """Return the result of a search that has a pose."""
    refined, pose, voxel = found.refined, found.refined.T_target_source, found.source.voxel
    alternatives = found.poses[1:][found.values[1:] >= found.values[0] - _AS_GOOD]
    motions = count_open_motions(refined.information, apply(pose, found.source.voxels.points))
    return Registration(
        T_target_source=pose,
        ok=found.probability >= ACCEPTED and motions <= MOST_OPEN_MOTIONS,
        probability=found.probability,
        fitness=found.fitness,
        inlier_rmse=refined.rmse,
        information=refined.information,
        open_motion=refined.open_motion,
        alternatives=alternatives,
        grouping=_verified_group(found.matches, pose, GROUP_WITHIN * voxel),
        correspondences=found.matches,
        voxel=voxel,
        notes=tuple(_notes(refined.open_motion, motions, len(alternatives))),
        seconds=seconds,
    )


def explain_failure(
    best: Registration | None, source: PreparedScan, target: PreparedScan, axis: FloatArray | None
) -> str:
    """Say that there is no pose, why, and what may help."""
    if best is None:
        reason = "no pose could be proposed" + ("" if axis is None else " that keeps the axis")
    elif best.probability >= ACCEPTED:
        return f"no pose that can be trusted: {best.notes[0]}"
    else:
        reason = (
            f"the best pose is right with a probability of {best.probability:.2f} only: it lays "
            f"{100 * best.fitness:.0f} % of the source on the target and {best.grouping.size} of "
            f"{len(best.correspondences)} matches together"
        )
    return f"no pose that can be trusted: {reason}; {_remedy(source, target, axis)}"


def _remedy(source: PreparedScan, target: PreparedScan, axis: FloatArray | None) -> str:
    sizes = source.scan.cloud.diagonal, target.scan.cloud.diagonal
    if max(sizes) > _SIZES_DIFFER * min(sizes):
        return (
            f"the clouds are {sizes[0]:.3g} and {sizes[1]:.3g} across: if both show the same, scale one, as "
            "scale is not estimated"
        )
    if axis is not None:
        return "the clouds may share too little, or not the axis"
    if source.viewpoint is None or target.viewpoint is None:
        return (
            "the clouds may share too little; if each is a single scan, say where the scanner stood by "
            "`source_viewpoint` and `target_viewpoint`"
        )
    return "the clouds may share too little, or a viewpoint may be wrong; `effort='high'` may find a pose"


def _verified_group(matches: Correspondences, pose: FloatArray, within: float) -> Grouping:
    """Return the matches that a pose lays together."""
    residuals = np.linalg.norm(apply(pose, matches.source) - matches.target, axis=1)
    positions = (matches.source, matches.target)
    run = Run("register", {"tolerance": within}, resolution=matches.resolution)
    return Grouping(residuals <= within, None, None, pose, {}, _positions=positions, _run=run)


def _notes(open_motion: FloatArray | None, motions: int, alternatives: int) -> list[str]:
    notes: list[str] = []
    if motions > MOST_OPEN_MOTIONS:
        notes.append(
            f"the surfaces leave {motions} of the six motions open, as a plane, a ball or a pipe does: give "
            "clouds that show more of the surroundings"
        )
    if open_motion is not None:
        turn, shift = open_motion[:3], open_motion[3:]
        notes.append(
            "the surfaces hardly resist a motion: rotation vector "
            f"({', '.join(f'{x:.3g}' for x in turn)}), translation ({', '.join(f'{x:.3g}' for x in shift)})"
        )
    if alternatives:
        notes.append(
            f"{alternatives} other pose{'s' if alternatives > 1 else ''} lay the surfaces together almost as "
            "well: the shape may be symmetric"
        )
    return notes
