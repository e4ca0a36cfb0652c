"""Rigid transforms: apply, invert, check, compare and convert them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.arrays import BoolArray, FloatArray, RealArray, as_floats, real_points
from cgroup._checks.values import as_instance
from cgroup.errors import InputError

RIGID_TOLERANCE = 1e-3
"""Largest deviation of R^T R from the identity in a transform file; such files carry few digits."""

_MOST = 1e150  # largest number of a transform, so that its square is finite
_NEXT, _LAST = [1, 2, 0], [2, 0, 1]  # axes that follow x, y, z


def apply(transform: FloatArray, points: RealArray) -> FloatArray:
    """Move points by a transform.

    Parameters
    ----------
    transform : (4,4) array of float64
        Used unchecked: it need not be rigid.
    points : (N,3) array of float32 or float64
        Points in any unit; not changed.

    Returns
    -------
    (N,3) array of float64
        R p + t of each.
    """
    matrix = _matrix("transform", transform)
    with np.errstate(invalid="ignore", over="ignore"):  # points that aren't finite stay so
        return real_points("points", points) @ matrix[:3, :3].T + matrix[:3, 3]


def invert(transform: FloatArray) -> FloatArray:
    """Invert a transform.

    Parameters
    ----------
    transform : (4,4) array of float64
        Inverted as a general matrix, so that few digits in its rotation don't matter.

    Returns
    -------
    (4,4) array of float64
        The inverse matrix.
    """
    try:
        return np.linalg.inv(_matrix("transform", transform)).astype(np.float64, copy=False)
    except np.linalg.LinAlgError as error:
        raise InputError(
            "transform", remedy="singular matrix, cannot be inverted; give a rigid transform"
        ) from error


def check_rigid(transform: ArrayLike, name: str = "transform") -> FloatArray:
    """Validate a 4x4 rigid transform of column vectors, or its first three rows.

    Parameters
    ----------
    transform : (4,4) or (3,4) array_like of float
        Rotation and translation.
    name : str
        Name of the transform in error messages.

    Returns
    -------
    (4,4) array of float64
        The same numbers as float64; the last row is 0 0 0 1.
    """
    matrix = _matrix(as_instance("name", name, str), transform)
    if not (np.abs(matrix) <= _MOST).all():
        raise InputError(name, remedy=f"holds a number that isn't finite, or is beyond {_MOST:g}")
    if not np.allclose(matrix[3], (0, 0, 0, 1), atol=1e-9):
        hint = "; transpose it" if np.allclose(matrix[:, 3], (0, 0, 0, 1), atol=1e-9) else ""
        raise InputError(name, remedy=f"last row is {matrix[3]}, not 0 0 0 1{hint}")
    rotation = matrix[:3, :3]
    deviation = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if deviation > RIGID_TOLERANCE or np.linalg.det(rotation) < 0:
        kind, hint = "a reflection" if deviation <= RIGID_TOLERANCE else "scaled or sheared", ""
        scale = float(np.linalg.norm(rotation[0]))
        if scale > 0 and are_rigid((matrix @ scaling(1.0 / scale))[None])[0]:
            kind = f"scaled by {scale:.5g}"
            hint = "; scale the source by that first, and divide the block by it"
        raise InputError(name, remedy=f"its upper left 3x3 block is {kind}, not a rotation{hint}")
    return matrix


def scaling(factor: float, middle: ArrayLike = (0.0, 0.0, 0.0)) -> FloatArray:
    """Return the transform (4,4) that scales about a point."""
    transform = np.diag([factor, factor, factor, 1.0])
    transform[:3, 3] = (1.0 - factor) * np.asarray(middle)
    return transform


def split_scale(transform: FloatArray) -> tuple[float, FloatArray]:
    """Split a similarity into its scale, which is applied first, and a rigid transform."""
    scale = float(np.cbrt(np.linalg.det(transform[:3, :3])))
    return scale, transform @ scaling(1.0 / scale)


def are_rigid(poses: FloatArray) -> BoolArray:
    """Return the mask of the 4x4 matrices that `check_rigid` accepts."""
    with np.errstate(invalid="ignore", over="ignore"):
        rotations = poses[:, :3, :3]
        deviations = np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)).max(axis=(1, 2))
        last = np.isclose(poses[:, 3], (0, 0, 0, 1), atol=1e-9).all(axis=1)
        # No determinant by LAPACK, which ends the process where it gets no working memory.
        side = (cross_products(rotations[:, 0], rotations[:, 1]) * rotations[:, 2]).sum(axis=1)
        rigid = (deviations <= RIGID_TOLERANCE) & (side > 0) & last
    return rigid & np.isfinite(poses).all(axis=(1, 2))


def as_poses(name: str, value: ArrayLike, count: int | None = None) -> FloatArray:
    """Return rigid transforms (N,4,4), and check their number if it is given."""
    poses = as_floats(name, value)
    if poses.size == 0:
        poses = poses.reshape(0, 4, 4)
    if poses.shape[1:] != (4, 4) or count not in (None, len(poses)):
        raise InputError(name, f"shape {poses.shape}", f"give ({'N' if count is None else count},4,4)")
    for row in np.flatnonzero(~are_rigid(poses)):
        check_rigid(poses[row], f"{name}[{row}]")
    return poses


def _matrix(name: str, transform: ArrayLike) -> FloatArray:
    matrix = as_floats(name, transform)
    if matrix.shape == (3, 4):
        return np.concatenate([matrix, [[0.0, 0.0, 0.0, 1.0]]])
    if matrix.shape != (4, 4):
        raise InputError(
            name, f"shape {matrix.shape}", "a rigid transform is a 4x4 matrix, or its first 3 rows"
        )
    return matrix


def rotation_error(estimated: ArrayLike, true: ArrayLike) -> float:
    """Return the angle between the rotations of two poses.

    Parameters
    ----------
    estimated, true : (4,4) array_like of float
        Rigid transforms.

    Returns
    -------
    float
        In degrees, 0 to 180.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.rigid import rotation_error
    >>> quarter_turn = np.eye(4)[[1, 0, 2, 3]] * [1, -1, 1, 1]
    >>> rotation_error(quarter_turn, np.eye(4))
    90.0
    """
    between = check_rigid(estimated, "estimated")[:3, :3].T @ check_rigid(true, "true")[:3, :3]
    return float(angles(between[None])[0])


def translation_error(estimated: ArrayLike, true: ArrayLike) -> float:
    """Return the distance between the translations of two poses.

    Parameters are as for `rotation_error`.

    Returns
    -------
    float
        In the data's unit. It depends on the origin of the source.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.rigid import translation_error
    >>> shift = np.eye(4)
    >>> shift[:3, 3] = [3, 4, 0]
    >>> translation_error(shift, np.eye(4))
    5.0
    """
    difference = check_rigid(estimated, "estimated")[:3, 3] - check_rigid(true, "true")[:3, 3]
    return float(np.linalg.norm(difference))


def angles(rotations: FloatArray) -> FloatArray:
    """Return the angles (n,) of rotations (n,3,3) in degrees, 0 to 180."""
    sines = (rotations - rotations.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]]
    # The sine keeps the precision that the arc cosine of the trace loses near 0 and 180 degrees.
    cosine = np.einsum("nii->n", rotations) - 1
    return np.degrees(np.arctan2(np.linalg.norm(sines, axis=1), cosine))


def quaternions(rotations: FloatArray) -> FloatArray:
    """Return unit quaternions (n,4), x y z w with w >= 0, of rotations (n,3,3).

    The quaternion is an eigenvector, after I. Y. Bar-Itzhack (*New method for extracting the quaternion from
    a rotation matrix*, 2000).
    """
    trace = np.einsum("nii->n", rotations)
    table = np.zeros((len(rotations), 4, 4))  # the lower triangle counts
    table[:, :3, :3] = rotations + rotations.transpose(0, 2, 1) - trace[:, None, None] * np.eye(3)
    table[:, 3, :3] = (rotations - rotations.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]]
    table[:, 3, 3] = trace
    found = np.linalg.eigh(table)[1][:, :, 3]
    return found * np.where(found[:, 3:] < 0, -1, 1) + 0.0  # no -0.0


def cross_products(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return cross products of rows (n,3); `np.cross` is much slower for few."""
    return one[:, _NEXT] * other[:, _LAST] - one[:, _LAST] * other[:, _NEXT]


def axis_of(transform: FloatArray) -> FloatArray:
    """Return the unit axis of a rotation by the right-hand rule; either one for half a turn."""
    rotation = transform[:3, :3]
    sines = rotation - rotation.T
    axis = np.array([sines[2, 1], sines[0, 2], sines[1, 0]])
    if np.trace(rotation) < 0:  # the sine fades towards half a turn
        turned = np.linalg.eigh(rotation + rotation.T)[1][:, -1]
        axis = -turned if turned @ axis < 0 else turned
    return axis / max(float(np.linalg.norm(axis)), 1e-300)


def turn(x: ArrayLike, y: ArrayLike, z: ArrayLike, w: ArrayLike) -> FloatArray:
    """Return rotations (...,3,3) of unit quaternions with separate parts (...)."""
    x, y, z, w = np.broadcast_arrays(*(np.asarray(part, dtype=np.float64) for part in (x, y, z, w)))
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))
