"""Poses that matches and groups propose, before any surface is looked at."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup._checks.arrays import as_place, in_double
from cgroup.errors import InputError, NoConsensusError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.types import Correspondences, FloatArray, Grouping

MAX_TILT = 10.0
"""Degrees by which a pose may tilt an axis that both clouds share."""


def frame_poses(matches: Correspondences) -> FloatArray:
    """Return the pose of every match that has frames: ``R_i = L'_i^T L_i``, ``t_i = q_i - R_i p_i``."""
    if matches.source_lrf is None or matches.target_lrf is None:
        return np.empty((0, 4, 4))
    rotations = np.einsum(
        "nji,njk->nik", in_double(matches.target_lrf), in_double(matches.source_lrf), optimize=True
    )
    framed = np.isfinite(rotations).all(axis=(1, 2))
    rotations = rotations[framed]
    poses = np.tile(np.eye(4), (len(rotations), 1, 1))
    poses[:, :3, :3] = rotations
    poses[:, :3, 3] = matches.target[framed] - np.einsum("nij,nj->ni", rotations, matches.source[framed])
    return poses


def group_poses(grouping: Grouping) -> FloatArray:
    """Return the poses that a group stands for: its model and alternatives, or else its least-squares fit."""
    if grouping.alternatives is not None:
        return grouping.alternatives
    if grouping.model is not None:
        return grouping.model[None]
    try:
        return grouping.transform()[None]
    except NoConsensusError:
        return np.empty((0, 4, 4))


def as_axis(axis: ArrayLike) -> FloatArray:
    """Return an axis as a unit vector."""
    direction = np.array(as_place("axis", axis))
    largest = float(np.abs(direction).max())
    if largest == 0:
        message = "axis: got a zero vector; give the direction that both clouds share, such as (0, 0, 1)"
        raise InputError(message)
    direction /= largest  # squares of the largest numbers are infinite, of the least zero
    return direction / np.linalg.norm(direction)


def keep_upright(poses: FloatArray, axis: FloatArray | None) -> FloatArray:
    """Drop the poses that tilt an axis by more than `MAX_TILT` degrees."""
    if axis is None:
        return poses
    cosines = np.einsum("i,nij,j->n", axis, poses[:, :3, :3], axis)
    return poses[cosines >= np.cos(np.radians(MAX_TILT))]


def is_upright(pose: FloatArray, axis: FloatArray | None) -> bool:
    """Whether a pose tilts an axis by no more than `MAX_TILT` degrees."""
    return len(keep_upright(pose[None], axis)) == 1
