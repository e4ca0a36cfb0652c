"""Redwood's error of a pose, from its definition.

Choi, Zhou and Koltun, *Robust reconstruction of indoor scenes*, CVPR 2015: with e = (t, q) of true^-1 estimated,
t its translation and q the vector part of its unit quaternion, the error is e' I e / I[0,0].
"""

import math

import numpy as np

from .result import FloatArray


def quaternion(rotation: FloatArray) -> FloatArray:
    """Return w x y z with w >= 0, by the largest of the four parts (Shepperd, 1978)."""
    r = rotation
    squares = [
        1 + r[0, 0] + r[1, 1] + r[2, 2],
        1 + r[0, 0] - r[1, 1] - r[2, 2],
        1 - r[0, 0] + r[1, 1] - r[2, 2],
        1 - r[0, 0] - r[1, 1] + r[2, 2],
    ]
    largest = int(np.argmax(squares))
    rows = [
        (squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]),
        (r[2, 1] - r[1, 2], squares[1], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]),
        (r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], squares[2], r[1, 2] + r[2, 1]),
        (r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], squares[3]),
    ]
    found = np.array(rows[largest]) / (2 * math.sqrt(squares[largest]))
    return -found if found[0] < 0 else found


def redwood_error(estimated: FloatArray, true: FloatArray, information: FloatArray) -> float:
    rotation = true[:3, :3].T @ estimated[:3, :3]
    translation = true[:3, :3].T @ (estimated[:3, 3] - true[:3, 3])
    e = [*translation, *quaternion(rotation)[1:]]
    total = sum(e[i] * information[i, j] * e[j] for i in range(6) for j in range(6))
    return float(total / information[0, 0])
