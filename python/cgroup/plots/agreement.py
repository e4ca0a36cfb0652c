"""Distances between two clouds under a pose, for colours."""

from __future__ import annotations

import numpy as np

from cgroup import _core
from cgroup._checks.values import run_options
from cgroup.features import normals
from cgroup.types import Correspondences, FloatArray, IndexArray

NEIGHBORS = 16
"""Number of points that define the plane about a point."""

_REACH = 2.5
"""Largest distance of a counterpart in the other cloud, in resolutions of the matches."""

_SHARE = 0.025  # of the target's deviation from its mean, instead of the resolution where matches have none


def color_range(matches: Correspondences, target: FloatArray) -> float:
    """Return the end of the colour scale: the resolution of the matches, 0.4 voxels in `register`."""
    return matches.resolution or _SHARE * float(np.sqrt(target.var(axis=0).sum())) or 1.0


def planes(points: FloatArray) -> FloatArray:
    """(N,3) normal of the plane about each point; zero where there is none."""
    if len(points) <= NEIGHBORS:
        return np.zeros_like(points)
    return np.nan_to_num(normals(points, neighbors=NEIGHBORS))


def distances(points: FloatArray, planes: FloatArray, others: FloatArray, end: float) -> FloatArray:
    """(N,) distance of the nearest other point from the plane about each point; NaN without a counterpart.

    This is the distance between surfaces; that of points is mostly the distance between samples.
    """
    offsets = _core.nearest(points, others, run_options(), _REACH * end)
    off_plane = np.abs(np.einsum("ij,ij->i", offsets, planes))
    return np.where(planes.any(axis=1), off_plane, np.linalg.norm(offsets, axis=1))


def thin(points: FloatArray, most: int) -> IndexArray:
    """Return rows of at most `most` points, a random part of more."""
    if len(points) <= most:
        return np.arange(len(points))
    return np.sort(np.random.default_rng(0).choice(len(points), most, replace=False))
