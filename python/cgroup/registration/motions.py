"""Motions that the surfaces hardly resist, and their description in words."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cgroup.rigid.se3 import about
from cgroup.types import FloatArray

# Share of the resistance of all pairs up to which a motion may be open, as for `Alignment.open_motion`
OPEN = 0.01
_SLIGHT = 0.1  # part of a motion that is left out of its description, beside the other part


def say_motion(vector: FloatArray, points: FloatArray) -> str:
    """Describe a motion (rotation vector, translation of the origin) of some points in words."""
    middle, radius = _middle(points)
    turn, shift = vector[:3], vector[3:] + np.cross(vector[:3], middle)
    angle, length = np.linalg.norm(turn), np.linalg.norm(shift)
    if angle * radius < _SLIGHT * length:
        return f"slide along {say_direction(_upwards(shift))}"
    words = f"turn about an axis along {say_direction(_upwards(turn))}"
    is_screw = abs(shift @ turn) > _SLIGHT * angle**2 * radius
    return f"{words} while sliding along it" if is_screw else words


def _upwards(vector: FloatArray) -> FloatArray:
    """Return a vector or its opposite, such that the largest coordinate is positive."""
    return vector * np.sign(vector[np.argmax(np.abs(vector))])


def say_direction(vector: FloatArray) -> str:
    """Write a direction as a unit vector of two decimals."""
    x, y, z = np.round(vector / np.linalg.norm(vector), 2) + 0.0  # no -0.00
    return f"({x:.2f}, {y:.2f}, {z:.2f})"


class Resistance(NamedTuple):
    """Resistance of the surfaces to motions about their centre."""

    values: FloatArray  # (6,), of each motion, the least first, as a share of the resistance of all pairs
    # (6,6), one per row: a rotation vector and the translation of the middle, of a size that moves the
    # points by about one unit
    motions: FloatArray
    middle: FloatArray  # (3,), median of the points
    scale: FloatArray  # (6,), rotations by the inverse of the points' median distance from the middle
    weight: float  # sum of the pairs' weights


def resistance(information: FloatArray, points: FloatArray) -> Resistance:
    """Decompose the matrix of a point-to-plane step into motions about the centre of the points."""
    middle, radius = _middle(points)
    scale = np.array([1 / radius] * 3 + [1.0] * 3)
    change = np.linalg.inv(about(middle)) * scale
    weight = float(np.trace(information[3:, 3:]))  # normals are of unit length
    values, vectors = np.linalg.eigh(change.T @ information @ change)
    return Resistance(values / max(weight, 1e-300), vectors.T * scale, middle, scale, weight)


def _middle(points: FloatArray) -> tuple[FloatArray, float]:
    """Return the median of the points and the median distance from it, both robust to outliers."""
    middle = np.median(points, axis=0)
    return middle, float(np.median(np.linalg.norm(points - middle, axis=1)))
