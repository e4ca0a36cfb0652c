"""KISS-Matcher.

Lim et al.: KISS-Matcher: Fast and robust point cloud registration revisited, ICRA 2025.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup.benchmark.pipelines.problem import Answer

if TYPE_CHECKING:
    from cgroup._runtime.progress import StageClock
    from cgroup.benchmark.pipelines.problem import Problem

VOXEL = 0.3
"""KISS-Matcher refuses small voxels, so clouds are scaled to its default; nothing else in it has a length."""

LEAST_INLIERS = 5
"""Its examples hold a registration with fewer final inliers to have failed."""


def estimate(problem: Problem, clock: StageClock) -> Answer:
    """Run it with its defaults at the given voxel."""
    library = importlib.import_module("kiss_matcher")
    scale = VOXEL / problem.voxel
    source, target = problem.source * scale, problem.target * scale
    clock.start("pose")
    matcher = library.KISSMatcher(library.KISSMatcherConfig(VOXEL))
    found = matcher.estimate(source, target)
    total = clock.stop().pop("pose")
    clock.seconds |= _split(matcher, total)
    if not found.valid:
        return Answer(None, ok=False)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = found.rotation, np.ravel(found.translation) / scale
    return Answer(pose, ok=matcher.get_num_final_inliers() >= LEAST_INLIERS)


def _split(matcher: Any, total: float) -> dict[str, float]:  # noqa: ANN401 - it has no types
    """Split the time of a call into the stages that the library takes the times of."""
    features = matcher.get_processing_time() + matcher.get_extraction_time()
    matching = matcher.get_matching_time()
    return {"features": features, "matching": matching, "pose": total - features - matching}
