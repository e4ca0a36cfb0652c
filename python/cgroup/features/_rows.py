"""Checks arguments that have one row per keypoint."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup._arguments import as_reals
from cgroup.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.types import IndexArray, RealArray


def as_rows(name: str, value: ArrayLike) -> IndexArray:
    """Return `value` as (m,) int64, rows of a cloud."""
    array = np.asarray(value)
    if array.size == 0 and array.ndim <= 1:
        return np.empty(0, dtype=np.int64)
    if array.dtype.kind not in "iu" or array.ndim != 1:
        message = (
            f"{name}: got shape {array.shape} of {array.dtype}; give (m,) whole numbers, rows of `points`"
        )
        raise InputError(message)
    if (array < 0).any():
        row = int(np.argmax(array < 0))
        message = f"{name}: got index {array[row]} in row {row}; give rows of `points`, counted from 0"
        raise InputError(message)
    return np.ascontiguousarray(array, dtype=np.int64)


def as_descriptors(name: str, value: ArrayLike) -> RealArray:
    """Return `value` as (n,d) float32 or float64."""
    array = as_reals(name, value)
    if array.ndim != 2 or array.shape[1] == 0:
        message = f"{name}: got shape {array.shape}; give (n,d), one descriptor per row"
        raise InputError(message)
    return array
