"""The paper's levels of clutter, occlusion and overlap."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from cgroup.types import FloatArray


@dataclass(frozen=True)
class Bins:
    """Levels of a property of pairs, evenly spaced and ascending.

    By the rule "nearest" a value belongs to the nearest level; by "from" to the greatest level not above it,
    up to one spacing above the last level, inclusive.
    """

    levels: tuple[float, ...]
    rule: Literal["nearest", "from"]


# The paper's, section 4.3.
CLUTTER = Bins((0.65, 0.70, 0.75, 0.80, 0.85, 0.90, 0.95), "nearest")
OCCLUSION = Bins((0.60, 0.65, 0.70, 0.75, 0.80, 0.85, 0.90), "nearest")
OVERLAP = Bins((0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9), "from")
LEAST_PAIRS = 5  # least number of pairs of a level; the mean of fewer is unreliable
_ROUNDING = 1e-9  # 0.7 read from a file belongs to the level 0.7


def binned(values: ArrayLike, bins: Bins) -> FloatArray:
    """Replace each value (n,) in [0,1] by its level; NaN for a value outside all levels."""
    given = np.asarray(values, dtype=np.float64)
    levels = np.array(bins.levels)
    step = levels[1] - levels[0]
    place = (given - levels[0]) / step
    if bins.rule == "nearest":
        place = np.clip(np.floor(place + 0.5 + _ROUNDING), 0, len(levels) - 1)
    else:
        end = np.abs(place - len(levels)) <= _ROUNDING
        place = np.where(end, len(levels) - 1, np.floor(place + _ROUNDING))
    inside = (place >= 0) & (place < len(levels))
    chosen = np.where(inside, place, 0).astype(np.intp)
    return np.where(inside, levels[chosen], np.nan)
