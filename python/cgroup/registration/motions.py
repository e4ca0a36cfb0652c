"""Small motions: a rotation vector, and the translation of a point."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup.rigid import apply

if TYPE_CHECKING:
    from cgroup.types import FloatArray

_SLIGHT = 0.1
"""Part of a motion that is left out of its description, beside the other part."""


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


def say_motion(vector: FloatArray, points: FloatArray) -> str:
    """Put a motion (rotation vector, translation of the origin) of some points into words."""
    middle, radius = _middle(points)
    turn, shift = vector[:3], vector[3:] + np.cross(vector[:3], middle)
    angle, length = np.linalg.norm(turn), np.linalg.norm(shift)
    if angle * radius < _SLIGHT * length:
        return f"slide along {say_direction(_upwards(shift))}"
    words = f"turn about an axis along {say_direction(_upwards(turn))}"
    is_screw = abs(shift @ turn) > _SLIGHT * angle**2 * radius
    return f"{words} while sliding along it" if is_screw else words


def _upwards(vector: FloatArray) -> FloatArray:
    """Return a vector or its opposite, whose largest coordinate is positive."""
    return vector * np.sign(vector[np.argmax(np.abs(vector))])


def say_direction(vector: FloatArray) -> str:
    """Write a direction as a unit vector of two decimals."""
    x, y, z = np.round(vector / np.linalg.norm(vector), 2) + 0.0  # no -0.00
    return f"({x:.2f}, {y:.2f}, {z:.2f})"


class Resistance(NamedTuple):
    """How much the surfaces resist motions about their middle.

    Attributes
    ----------
    values : (6,) array of float64
        Of the motions, from the one that they resist least, as shares of the resistance of all pairs.
    motions : (6,6) array of float64
        One per row: a rotation vector and the translation of the middle, of a size that moves the points by
        about one unit.
    middle : (3,) array of float64
        Median of the points.
    scale : (6,) array of float64
        Rotations by the inverse of the points' median distance from the middle.
    weight : float
        Sum of the pairs' weights.
    """

    values: FloatArray
    motions: FloatArray
    middle: FloatArray
    scale: FloatArray
    weight: float


def resistance(information: FloatArray, points: FloatArray) -> Resistance:
    """Take the matrix of a point-to-plane step apart into motions about the points' middle."""
    middle, radius = _middle(points)
    scale = np.array([1 / radius] * 3 + [1.0] * 3)
    change = np.linalg.inv(about(middle)) * scale
    weight = float(np.trace(information[3:, 3:]))  # normals are of unit length
    values, vectors = np.linalg.eigh(change.T @ information @ change)
    return Resistance(values / max(weight, 1e-300), vectors.T * scale, middle, scale, weight)


def _middle(points: FloatArray) -> tuple[FloatArray, float]:
    """Medians of the points, and of their distances from it: a few stray points don't move them."""
    middle = np.median(points, axis=0)
    return middle, float(np.median(np.linalg.norm(points - middle, axis=1)))
