"""How many motions two surfaces leave open: a ball turns, a plane slides, and nothing there fixes a pose."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from cgroup.types import FloatArray

MOST_OPEN_MOTIONS = 1
"""Motions that may be open: along a corridor a pose is still of use."""

_OPEN = 0.01  # share of the resistance of all pairs, as for `Alignment.open_motion`


def count_open_motions(information: FloatArray, points: FloatArray) -> int:
    """Count the motions that surfaces hardly resist.

    Parameters
    ----------
    information : (6,6) array of float64
        ``sum w J^T J`` for a rotation vector about the origin and a translation.
    points : (N,3) array of float64
        Of the surfaces, in the same frame.

    Returns
    -------
    int
        Eigenvalues below 0.01 of the sum of weights, with rotations about the median of the points and scaled
        by their median distance from it: 3 for a plane or a ball, 2 for a pipe, 1 for a corridor.
    """
    center = np.median(points, axis=0)  # a few stray points don't move it
    radius = np.median(np.linalg.norm(points - center, axis=1))
    x, y, z = center
    change = np.eye(6)
    change[3:, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    change[:, :3] /= radius
    weight = np.trace(information[3:, 3:])  # normals are of unit length
    return int((np.linalg.eigvalsh(change.T @ information @ change) <= _OPEN * weight).sum())
