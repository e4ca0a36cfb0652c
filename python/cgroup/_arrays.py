"""Turns whatever the user passes into float64 arrays of the right shape, or says what is wrong."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.types import FloatArray


def as_floats(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as a float64 array; it is not copied where it is one already."""
    try:
        array = np.asarray(value)
    except (ValueError, TypeError) as error:
        message = (
            f"{name}: got {type(value).__name__}, which is no array: {error}; give a numpy array of numbers"
        )
        raise InputError(message) from error
    if array.dtype.kind not in "fiub":
        message = f"{name}: got an array of {array.dtype}; give real numbers"
        raise InputError(message)
    return array.astype(np.float64, copy=False)


def as_points(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as (n,3) float64."""
    array = as_floats(name, value)
    if array.size == 0 and array.ndim <= 2:
        return array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3:
        hint = "transpose it" if array.ndim == 2 and array.shape[0] == 3 else "one row of x, y, z per point"
        message = f"{name}: got shape {_shape(array)}; give (n,3): {hint}"
        raise InputError(message)
    return array


def as_vector(name: str, value: ArrayLike, rows: int | None) -> FloatArray:
    """Return `value` as (n,) float64 with n = `rows`, where that is known."""
    array = as_floats(name, value)
    if array.ndim != 1 or (rows is not None and len(array) != rows):
        expected = "(n,)" if rows is None else f"({rows},)"
        message = f"{name}: got shape {_shape(array)}; give {expected}: one number per correspondence"
        raise InputError(message)
    return array


def as_frames(name: str, value: ArrayLike, rows: int) -> FloatArray:
    """Return `value` as (n,3,3) float64; rows of a block are the x, y and z axes."""
    array = as_floats(name, value)
    if array.size == 0 and rows == 0:
        return array.reshape(0, 3, 3)
    if array.shape != (rows, 3, 3):
        message = (
            f"{name}: got shape {_shape(array)}; give ({rows},3,3): one frame per correspondence, "
            "its rows the x, y and z axes, NaN for no frame"
        )
        raise InputError(message)
    return array


def _shape(array: FloatArray) -> str:
    return "(" + ",".join(map(str, array.shape)) + ")"
