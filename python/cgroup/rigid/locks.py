"""Locked axes: the likeliest pose that keeps some of its six parameters."""

from typing import NamedTuple

import numpy as np

from cgroup._checks.arrays import BoolArray, FloatArray
from cgroup._checks.values import refusal
from cgroup.rigid.se3 import about, motion, rotation_vectors

AXES = ("roll", "pitch", "yaw", "x", "y", "z")
_ROUNDS = 10
_REMEDY = f"give names of {', '.join(AXES)} with commas between, as 'yaw,x,y,z'; one rotation, three or none"


class Locks(NamedTuple):
    """The locked parameters, (6,), and a pose that has their values."""

    mask: BoolArray
    pose: FloatArray

    @property
    def axis(self) -> FloatArray | None:
        """The axis of the only free rotation; None for three or none."""
        return None if self.mask[:3].sum() != 2 else (~self.mask[:3]).astype(np.float64)

    @property
    def shared_axis(self) -> FloatArray | None:
        """The axis of the only free rotation, if the pose keeps it."""
        axis = self.axis
        return axis if axis is not None and np.allclose(self.pose[:3, :3] @ axis, axis) else None

    def excess(self, pose: FloatArray) -> FloatArray:
        """Return the motion of a pose away from the locked values, (6,), zero along free parameters."""
        turn = pose[:3, :3] @ self.pose[:3, :3].T
        if self.axis is None:
            rotation = rotation_vectors(turn[None])[0]
        else:  # the least rotation that moves the axis as `turn` does
            moved = turn @ self.axis
            across = np.cross(self.axis, moved)
            sine = float(np.linalg.norm(across))
            rotation = across * (np.arctan2(sine, moved @ self.axis) / sine) if sine else np.zeros(3)
        return np.where(self.mask, np.concatenate([rotation, pose[:3, 3] - self.pose[:3, 3]]), 0.0)

    def condition(self, pose: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the likeliest pose with the locked values, and its covariance.

        The pose and its covariance are taken as a normal distribution, conditioned on the values.
        """
        place, rows = pose[:3, 3], np.flatnonzero(self.mask)
        there = about(place) @ covariance @ about(place).T
        if not np.isfinite(there).all():
            there = np.eye(6)
        gain = np.linalg.lstsq(there[np.ix_(rows, rows)], there[rows], rcond=None)[0].T
        change, locked = np.zeros(6), pose
        for _ in range(_ROUNDS):
            change = gain @ (change - self.excess(locked))[rows]
            locked = motion(change, place) @ pose
        locked = motion(-self.excess(locked), locked[:3, 3]) @ locked  # what rounding leaves
        locked[:3, 3] = np.where(self.mask[3:], self.pose[:3, 3], locked[:3, 3])
        left = there - gain @ there[rows]
        left[rows] = left[:, rows] = 0.0
        return locked, about(-place) @ left @ about(-place).T


def as_locks(free: object, pose: FloatArray | None) -> Locks:
    """Return locks of all parameters but the named ones, at the values of a pose, by default the identity."""
    if free is None:
        free = ",".join(AXES)
    names = [name.strip() for name in free.split(",")] if isinstance(free, str) else [""]
    mask = np.array([axis not in names for axis in AXES])
    if not {*names} <= {*AXES} or mask[:3].sum() == 1:
        raise refusal("free", free, _REMEDY)
    return Locks(mask, np.eye(4) if pose is None else pose)
