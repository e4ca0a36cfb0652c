"""Refine one pose and estimate its probability alone, without matches or rivals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cgroup.registration.covariance import count_open_motions
from cgroup.registration.evidence import gather
from cgroup.registration.judge import (
    Case,
    Found,
    bound_by_motions,
    bound_by_size,
    misfit,
    share_probability,
)
from cgroup.registration.own import match_nothing
from cgroup.registration.prepare import PreparedScan, fine_surfaces
from cgroup.registration.similarity import compare_scales
from cgroup.rigid import invert
from cgroup.types import FloatArray
from cgroup.verification import align, verify


def confirm_pose(
    source: PreparedScan, target: PreparedScan, pose: FloatArray, threads: int | None
) -> Found | None:
    """Refine a pose on the fine surfaces, and estimate its probability alone; None without overlap."""
    refined = align(*fine_surfaces(source, target), pose, threads=threads)
    if len(refined.residuals) == 0:
        return None
    placed = refined.T_target_source
    verified = verify(source.surface, target.surface, placed, threads=threads)
    back = verify(target.surface, source.surface, invert(placed), threads=threads)
    case = Case(float(verified.scores[0]), 0, misfit(refined, source.voxel), gather(source, target, placed))
    motions = count_open_motions(refined, source, target)
    if motions == 0:
        refined = replace(refined, open_motion=None)
    found = Found(
        refined,
        np.empty((0, 4, 4)),
        bound_by_size(bound_by_motions(share_probability(case, [])[0], motions), source, target),
        verified.fitness,
        match_nothing(source),
        source,
        target,
        motions=motions,
        cases=(case,),
        target_fitness=back.fitness,
        places=placed[None],
    )
    return compare_scales(found)
