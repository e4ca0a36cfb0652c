"""RANSAC on the group of another method (section 6 of the paper)."""

import functools
from typing import Any

import numpy as np

from cgroup.group import group
from cgroup.types import BoolArray, Correspondences, Grouping


def _then_ransac(
    first: str,
    correspondences: Correspondences,
    *,
    seed: int = 0,
    threads: int | None = None,
    **options: Any,  # noqa: ANN401 - of the first method
) -> Grouping:
    """Return RANSAC's inliers in the first method's group, aligned with all matches."""
    kept = group(correspondences, first, threads=threads, **options).indices
    subset = Correspondences(
        correspondences.source[kept], correspondences.target[kept], resolution=correspondences.resolution
    )
    found = group(subset, "ransac", seed=seed, threads=threads)
    mask: BoolArray = np.zeros(len(correspondences), dtype=bool)
    mask[kept[found.mask]] = True
    return Grouping(mask, None, None, found.model, found.diagnostics)


gc_then_ransac = functools.partial(_then_ransac, "gc")
gtm_then_ransac = functools.partial(_then_ransac, "gtm")
