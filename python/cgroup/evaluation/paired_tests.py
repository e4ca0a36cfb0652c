"""Tests of methods on the same units."""

from __future__ import annotations

from math import comb
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike


def mcnemar(one: ArrayLike, other: ArrayLike) -> float:
    """Return the p of McNemar's exact test on paired successes."""
    first, second = np.asarray(one, dtype=bool), np.asarray(other, dtype=bool)
    only_first, only_second = int((first & ~second).sum()), int((second & ~first).sum())
    count = only_first + only_second
    tail = sum(comb(count, k) for k in range(min(only_first, only_second) + 1))
    return min(1.0, 2 * tail / 2**count)


def holm(p: Sequence[float]) -> list[float]:
    """Adjust the p of several tests, so that the chance of any false alarm keeps.

    After Holm, Scandinavian Journal of Statistics 1979.
    """
    adjusted = [0.0] * len(p)
    so_far = 0.0
    for rank, i in enumerate(sorted(range(len(p)), key=lambda i: p[i])):
        so_far = max(so_far, min(1.0, (len(p) - rank) * p[i]))
        adjusted[i] = so_far
    return adjusted
