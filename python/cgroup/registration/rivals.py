"""Propose rivals of a pose: slides along weak motions, and rotations about the axes of the normals."""

from __future__ import annotations

import itertools

import numpy as np

from cgroup.registration.motions import resistance
from cgroup.registration.prepare import PreparedScan
from cgroup.rigid import apply
from cgroup.rigid.se3 import motion
from cgroup.types import FloatArray

_STEP, _FIRST, _LAST = 4.0, 10.0, 62.0  # of slides, in voxels
_DIRECTIONS = 2
_QUARTERS = (90.0, 180.0, 270.0)


def propose_rivals(
    source: PreparedScan, target: PreparedScan, pose: FloatArray, information: FloatArray
) -> FloatArray:
    """Propose unverified poses of the source, (m,4,4): slides and rotations of a pose.

    Slides follow the two directions and the motion that the surfaces resist least (along a wall, about the
    axis of a gear), by 10 to 62 voxels; turns are by quarters about the axes of the target's normals, through
    the centre of the source.
    """
    points = apply(pose, source.voxels.points)
    slides = np.arange(_FIRST, _LAST, _STEP) * target.voxel
    directions = np.linalg.eigh(information[3:, 3:])[1][:, :_DIRECTIONS].T
    resisted = resistance(information, points)
    weakest = np.concatenate([np.pad(directions, ((0, 0), (3, 0))), resisted.motions[:1]])
    slid = [sign * slide * vector for vector, slide, sign in itertools.product(weakest, slides, (-1.0, 1.0))]
    normals = target.normals[np.isfinite(target.normals).all(axis=1)]
    axes = np.linalg.eigh(normals.T @ normals)[1].T
    local = points @ axes.T
    middles = (points.mean(axis=0), axes.T @ (np.quantile(local, [0.02, 0.98], axis=0).mean(axis=0)))
    turned = np.pad([np.radians(degrees) * axis for axis in axes for degrees in _QUARTERS], ((0, 0), (0, 3)))
    turns = np.stack([motion(turned, middle) for middle in middles], axis=1).reshape(-1, 4, 4)
    return np.concatenate([motion(np.array(slid), resisted.middle), turns]) @ pose
