"""Poses as lines of text, in as many decimals as reproduce what they move."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

_EXACT = 1e-9
"""Part of its extent by which a printed pose may move a cloud elsewhere."""

_NARROWEST = 12  # columns of a number


def pose_lines(pose: ArrayLike, middle: ArrayLike | None = None, extent: float | None = None) -> list[str]:
    """Write a transform row by row.

    Parameters
    ----------
    pose : (4,4) array_like of float
        Rigid, or a similarity.
    middle : (3,) array_like of float, optional
        Mean of the points that it moves.
    extent : float, optional
        Diagonal of the box around them. The decimals suffice to move all points to within 1e-9 of it; where
        it is unknown, numbers are exact.
    """
    matrix = np.asarray(pose, dtype=float)
    turning = shifting = None
    if middle is not None and extent:
        reach = float(np.linalg.norm(np.asarray(middle, dtype=float))) + extent
        allowed = _EXACT * extent * float(np.linalg.norm(matrix[:3, 0]))
        # Half a unit of the last decimal moves a point by up to 3 reach / 2, and by sqrt(3) / 2.
        turning, shifting = _decimals(3 * reach / allowed), _decimals(math.sqrt(3) / allowed)
    rows = [
        [_show(number, shifting if k == 3 else turning) for k, number in enumerate(row)] for row in matrix
    ]
    width = max(_NARROWEST, *(len(number) for row in rows for number in row))
    return [" ".join(f"{number:>{width}}" for number in row) for row in rows]


def _decimals(ratio: float) -> int | None:
    """Return how many decimals make rounding, of which one is allowed in so many units, small enough."""
    return max(0, math.ceil(math.log10(ratio))) if 0 < ratio < math.inf else None


def _show(number: float, decimals: int | None) -> str:
    """Write a number as short as it is exact, or with so many decimals at most."""
    if decimals is None or not math.isfinite(number):
        return repr(float(number)).removesuffix(".0")
    text = np.format_float_positional(number, precision=decimals, unique=True, trim="-")
    return "0" if text == "-0" else text
