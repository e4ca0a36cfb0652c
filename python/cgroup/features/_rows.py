"""Checks of descriptor tables."""

from __future__ import annotations

from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_reals
from cgroup.errors import InputError
from cgroup.types import RealArray


def as_descriptors(name: str, value: ArrayLike) -> RealArray:
    """Return `value` as (n,d) float32 or float64."""
    array = as_reals(name, value)
    if array.ndim != 2 or array.shape[1] == 0:
        raise InputError(name, f"shape {array.shape}", "give (n,d), one descriptor per row")
    return array
