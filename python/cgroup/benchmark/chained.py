"""RANSAC on what another method has selected, to see how many more pairs it registers then."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup.group import group
from cgroup.types import Correspondences, Grouping

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cgroup.types import BoolArray


def gc_then_ransac(
    correspondences: Correspondences,
    *,
    seed: int = 0,
    threads: int | None = None,
    **options: Any,  # noqa: ANN401 - GC's own
) -> Grouping:
    """RANSAC on the group of GC; see `gtm_then_ransac`."""
    return _then_ransac("gc", correspondences, seed, threads, options)


def gtm_then_ransac(
    correspondences: Correspondences,
    *,
    seed: int = 0,
    threads: int | None = None,
    **options: Any,  # noqa: ANN401 - GTM's own
) -> Grouping:
    """RANSAC on the group of GTM (paper, section 6).

    Parameters
    ----------
    correspondences : Correspondences
        The problem.
    seed : int
        Of RANSAC.
    threads : int, optional
        None for all cores.
    **options
        Of the first method.

    Returns
    -------
    Grouping
        RANSAC's inliers within the first method's group, aligned with all correspondences.
    """
    return _then_ransac("gtm", correspondences, seed, threads, options)


def _then_ransac(
    first: str,
    correspondences: Correspondences,
    seed: int,
    threads: int | None,
    options: Mapping[str, Any],
) -> Grouping:
    kept = group(correspondences, first, threads=threads, **options).indices
    subset = Correspondences(
        correspondences.source[kept], correspondences.target[kept], resolution=correspondences.resolution
    )
    found = group(subset, "ransac", seed=seed, threads=threads)
    mask: BoolArray = np.zeros(len(correspondences), dtype=bool)
    mask[kept[found.mask]] = True
    return Grouping(mask, None, None, found.model, found.diagnostics)
