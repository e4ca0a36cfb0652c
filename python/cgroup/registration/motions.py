"""Small motions: a rotation vector, and the translation of a point."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.rigid import apply

if TYPE_CHECKING:
    from cgroup.types import FloatArray


def cross(vector: FloatArray) -> FloatArray:
    """Matrix of the cross product with a vector."""
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def motion(vector: FloatArray, point: FloatArray) -> FloatArray:
    """Transform of a motion (rotation vector, translation of the point)."""
    angle = float(np.linalg.norm(vector[:3]))
    turn = cross(vector[:3])
    transform = np.eye(4)
    # sin(a) / a and (1 - cos(a)) / a^2, with limits at 0
    transform[:3, :3] += np.sinc(angle / np.pi) * turn + np.sinc(angle / (2 * np.pi)) ** 2 / 2 * (turn @ turn)
    transform[:3, 3] = point + vector[3:] - transform[:3, :3] @ point
    return transform


def vector_of(transform: FloatArray, point: FloatArray) -> FloatArray:
    """Motion (rotation vector, translation of the point) of a transform; by less than half a turn."""
    turn = transform[:3, :3]
    sines = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    sine = np.linalg.norm(sines)
    angle = np.arctan2(sine, (np.trace(turn) - 1) / 2)
    return np.concatenate([sines * (angle / sine if sine else 1.0), apply(transform, point[None])[0] - point])


def about(point: FloatArray) -> FloatArray:
    """Change of motions: from the translation of the origin to that of a point; of small ones."""
    change = np.eye(6)
    change[3:, :3] = -cross(point)
    return change


def adjoint(pose: FloatArray) -> FloatArray:
    """Change of motions by a pose: ``pose Exp(x) = Exp(Ad x) pose``."""
    change = np.zeros((6, 6))
    change[:3, :3] = change[3:, 3:] = pose[:3, :3]
    change[3:, :3] = cross(pose[:3, 3]) @ pose[:3, :3]
    return change
