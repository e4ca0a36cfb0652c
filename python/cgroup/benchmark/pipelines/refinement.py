"""Refinement of a pose by small_gicp (Koide, *small_gicp*, Journal of Open Source Software 2024)."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from cgroup.benchmark.pipelines.problem import Problem
    from cgroup.types import FloatArray

VOXEL = 0.3
"""Clouds are scaled so that voxels have this size, to which small_gicp's defaults, in m, are made."""


def refine(problem: Problem, pose: FloatArray) -> FloatArray:
    """Refine a pose by generalized ICP with small_gicp's defaults."""
    library = importlib.import_module("small_gicp")
    scale = VOXEL / problem.voxel
    start = pose.copy()
    start[:3, 3] *= scale
    found = library.align(
        problem.target * scale,
        problem.source * scale,
        init_T_target_source=start,
        num_threads=problem.threads,
    )
    refined = np.array(found.T_target_source, dtype=np.float64)
    refined[:3, 3] /= scale
    return refined
