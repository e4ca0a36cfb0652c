"""Poses in numbers: matrices, rows of matrices, translations with quaternions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup._checks.arrays import as_floats
from cgroup.errors import InputError
from cgroup.rigid import RIGID_TOLERANCE, check_rigid, turn

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cgroup.types import FloatArray

NOTATIONS = (
    "a pose is 4 rows of 4 numbers, or 3 of 4; 16 or 12 numbers, row by row; tx ty tz qx qy qz qw; "
    "or these after a time"
)

_MATRICES, _QUATERNIONS = (12, 16), (7, 8)
"""Numbers of a pose in one row."""


def find_poses(name: str, numbers: NDArray[Any]) -> FloatArray:
    """Return the poses that numbers stand for, told by their shape.

    Parameters
    ----------
    name : str
        What errors call them.
    numbers : array
        (4,4) or (3,4), or (m,) of these; or one row per pose: 16 or 12 numbers row by row, 7 (tx ty tz qx qy
        qz qw), or 8 (the same after a time, as TUM has it); or the numbers of one such row alone.

    Returns
    -------
    (m,4,4) array of float64
        Rigid transforms.

    Raises
    ------
    InputError
        For another shape, numbers column by column, quaternions that are not of length 1, and whatever else
        is not rigid; it names the pose, counted from 1.
    """
    values = as_floats(name, numbers)
    rows, columns = (values.shape[-2:]) if values.ndim >= 2 else (1, values.size)
    if values.ndim == 2 and columns == 1:
        rows, columns = 1, rows
    if values.ndim <= 2 and rows and columns in _QUATERNIONS:
        poses = _from_quaternions(name, values.reshape(rows, columns)[:, -7:])
    elif values.ndim <= 2 and rows and columns in _MATRICES:
        poses = values.reshape(rows, -1, 4)
        _refuse_columns_first(name, poses)
    elif values.size and columns == 4 and (rows in (3, 4) if values.ndim == 3 else _are_matrices(values)):
        poses = values.reshape(-1, min(rows, 4), 4)
    else:
        raise _refusal(name, values)
    return _checked(name, _with_last_row(poses))


def _are_matrices(values: FloatArray) -> bool:
    """Whether rows of 4 numbers are a 3x4 matrix, or one or more 4x4 matrices below each other."""
    return values.ndim == 2 and (len(values) == 3 or len(values) % 4 == 0)


def _with_last_row(poses: FloatArray) -> FloatArray:
    if poses.shape[1] == 4:
        return poses
    last = np.broadcast_to([[0.0, 0.0, 0.0, 1.0]], (len(poses), 1, 4))
    return np.concatenate([poses, last], axis=1)


def _from_quaternions(name: str, rows: FloatArray) -> FloatArray:
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(rows[:, 3:], axis=1)
        firsts = np.linalg.norm(rows[:, :4], axis=1)
    wrong = np.flatnonzero(~(np.abs(lengths - 1) <= RIGID_TOLERANCE))
    if len(wrong):
        first = abs(firsts[wrong[0]] - 1) <= RIGID_TOLERANCE
        hint = "; the first four numbers are one: write tx ty tz qx qy qz qw" if first else ""
        message = (
            f"{_pose_name(name, int(wrong[0]), len(rows))}: its quaternion is of length "
            f"{lengths[wrong[0]]:.6g}, not 1{hint}"
        )
        raise InputError(message)
    x, y, z, w = (rows[:, 3:] / lengths[:, None]).T
    poses = np.zeros((len(rows), 3, 4))
    poses[:, :, 3] = rows[:, :3]
    poses[:, :, :3] = turn(x, y, z, w)
    return poses


def _refuse_columns_first(name: str, poses: FloatArray) -> None:
    """Refuse rows of numbers that are poses only when they are read column by column."""
    if _are_rigid(_with_last_row(poses)).all():
        return
    rows = poses.shape[1]
    turned = poses.reshape(len(poses), 4, rows).transpose(0, 2, 1)
    if _are_rigid(_with_last_row(turned)).all():
        raise InputError(
            name,
            remedy=f"its {4 * rows} numbers are a pose column by column; transpose it: write row by row",
        )


def _are_rigid(poses: FloatArray) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore", over="ignore"):
        rotations = poses[:, :3, :3]
        deviations = np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)).max(axis=(1, 2))
        last = np.isclose(poses[:, 3], (0, 0, 0, 1), atol=1e-9).all(axis=1)
        rigid = (deviations <= RIGID_TOLERANCE) & (np.linalg.det(rotations) > 0) & last
    return rigid & np.isfinite(poses).all(axis=(1, 2))


def _checked(name: str, poses: FloatArray) -> FloatArray:
    for row in np.flatnonzero(~_are_rigid(poses)):
        check_rigid(poses[row], _pose_name(name, int(row), len(poses)))
    return poses


def _pose_name(name: str, row: int, count: int) -> str:
    return name if count == 1 else f"{name}: pose {row + 1} of {count}"


def _refusal(name: str, values: FloatArray) -> InputError:
    if values.shape == (4, 3):
        return InputError(f"{name}: got 4 rows of 3 numbers; transpose them: 3 rows of 4, the last column t")
    if values.ndim == 2:
        got = f"{len(values)} row{'s' if len(values) != 1 else ''} of {values.shape[1]} numbers"
    else:
        got = f"an array of shape {values.shape}"
    return InputError(f"{name}: got {got}; {NOTATIONS}")
