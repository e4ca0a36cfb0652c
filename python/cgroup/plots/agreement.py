"""How far two clouds lie from each other under a pose, point by point, for colours."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup import _core
from cgroup._checks.run_options import run_options
from cgroup.features import normals

if TYPE_CHECKING:
    from cgroup.types import Correspondences, FloatArray, IndexArray

NEIGHBORS = 16
"""Points of the plane about each point."""

_REACH = 2.5
"""Resolutions of the matches: a point with no point of the other cloud as near has no counterpart."""

_SHARE = 0.025  # of the target's deviation from its mean, instead of the resolution where matches have none


def color_range(matches: Correspondences, target: FloatArray) -> float:
    """Return the distance that colours end at: a resolution of the matches, 0.4 voxels in `register`."""
    return matches.resolution or _SHARE * float(np.sqrt(target.var(axis=0).sum())) or 1.0


def planes(points: FloatArray) -> FloatArray:
    """(N,3) normal of the plane about each point; zero where there is none."""
    if len(points) <= NEIGHBORS:
        return np.zeros_like(points)
    return np.nan_to_num(normals(points, neighbors=NEIGHBORS))


def distances(points: FloatArray, planes: FloatArray, others: FloatArray, end: float) -> FloatArray:
    """(N,) distance of the nearest other point from the plane about each point; NaN without a counterpart.

    Between surfaces, that is: the distance to the nearest point itself is mostly that between samples.
    """
    offsets = _core.nearest(points, others, run_options(), _REACH * end)
    off_plane = np.abs(np.einsum("ij,ij->i", offsets, planes))
    return np.where(planes.any(axis=1), off_plane, np.linalg.norm(offsets, axis=1))


def thin(points: FloatArray, most: int) -> IndexArray:
    """Return rows of at most so many points, a random part where there are more."""
    if len(points) <= most:
        return np.arange(len(points))
    return np.sort(np.random.default_rng(0).choice(len(points), most, replace=False))
