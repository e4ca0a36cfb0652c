"""Checks of poses."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_floats
from cgroup.errors import InputError
from cgroup.rigid import RIGID_TOLERANCE, cross_products
from cgroup.types import FloatArray


def as_poses(value: ArrayLike, name: str = "poses") -> FloatArray:
    """Return (m,4,4) rigid transforms."""
    poses = as_floats(name, value)
    if poses.ndim == 2:
        poses = poses[None]
    if poses.ndim != 3 or poses.shape[1:] != (4, 4) or len(poses) == 0:
        raise InputError(name, f"shape {poses.shape}", "give (m,4,4), at least one rigid transform")
    rotations = poses[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        squares = np.einsum("kji,kjl->kil", rotations, rotations)
        right = np.isfinite(poses).all(axis=(1, 2)) & (
            np.abs(squares - np.eye(3)).max(axis=(1, 2)) <= RIGID_TOLERANCE
        )
        # No determinant by LAPACK, which ends the process where it gets no working memory.
        side = (cross_products(rotations[:, 0], rotations[:, 1]) * rotations[:, 2]).sum(axis=1)
        right &= (np.abs(poses[:, 3] - (0, 0, 0, 1)).max(axis=1) <= 1e-9) & (side > 0)
    if not right.all():
        raise InputError(
            name,
            remedy=(
                f"pose {int(np.argmin(right))} of {len(poses)} is not rigid: [R t; 0 0 0 1] with a rotation "
                "R; leave out those of matches without frames"
            ),
        )
    return poses


def as_pose(value: ArrayLike) -> FloatArray:
    """Return a single rigid transform, as (1,4,4)."""
    poses = as_poses(value, "pose")
    if len(poses) != 1:
        raise InputError("pose", f"{len(poses)} poses", "give one (4,4) rigid transform")
    return poses
