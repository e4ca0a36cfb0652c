"""Turns whatever the user passes into arrays and numbers of the right kind, or says what is wrong."""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING

import numpy as np

from cgroup.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup._arrays import FloatArray, RealArray

LARGEST_COUNT = 2**64 - 1

AS_THEY_ARE = (np.dtype(np.float32), np.dtype(np.float64))
"""Types of numbers that the compiled core reads without a conversion."""


def as_floats(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as a contiguous, aligned float64 array; not copied where it is one already."""
    return in_double(as_reals(name, value))


def as_points(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as (n,3) float64."""
    return in_double(real_points(name, value))


def as_frames(name: str, value: ArrayLike, rows: int) -> FloatArray:
    """Return `value` as (n,3,3) float64; rows of a block are the x, y and z axes."""
    return in_double(real_frames(name, value, rows))


def in_double(array: RealArray) -> FloatArray:
    """Return `array` as float64; not copied where it is that already."""
    return array.astype(np.float64, copy=False)


def as_reals(name: str, value: ArrayLike) -> RealArray:
    """Return `value` as a contiguous, aligned float32 or float64 array; not copied where it is one."""
    if np.ma.is_masked(value):
        message = f"{name}: got a masked array; drop its masked rows first"
        raise InputError(message)
    try:
        array = np.asarray(value)
    except Exception as error:  # whatever the object's own conversion raises
        message = (
            f"{name}: got {type(value).__name__}, which is no array: {error}; give a numpy array of numbers"
        )
        raise InputError(message) from error
    if array.dtype.kind not in "fiub":
        message = f"{name}: got an array of {array.dtype}; give real numbers"
        raise InputError(message)
    if array.dtype not in AS_THEY_ARE:
        array = array.astype(np.float64)
    if array.flags.c_contiguous and array.flags.aligned:
        return array
    # Fields of packed records are neither aligned nor a whole number of elements apart.
    return np.require(array, None, ["C_CONTIGUOUS", "ALIGNED"])


def real_points(name: str, value: ArrayLike) -> RealArray:
    """Return `value` as (n,3) float32 or float64."""
    array = as_reals(name, value)
    if array.shape == (0,):
        return array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3:
        hint = "transpose it" if array.ndim == 2 and array.shape[0] == 3 else "one row of x, y, z per point"
        message = f"{name}: got shape {_shape(array)}; give (n,3): {hint}"
        raise InputError(message)
    return array


def real_vector(name: str, value: ArrayLike, rows: int | None) -> RealArray:
    """Return `value` as (n,) float32 or float64 with n = `rows`, where that is known."""
    array = as_reals(name, value)
    if array.ndim != 1 or (rows is not None and len(array) != rows):
        expected = "(n,)" if rows is None else f"({rows},)"
        message = f"{name}: got shape {_shape(array)}; give {expected}: one number per correspondence"
        raise InputError(message)
    return array


def real_frames(name: str, value: ArrayLike, rows: int) -> RealArray:
    """Return `value` as (n,3,3) float32 or float64; rows of a block are the x, y and z axes."""
    array = as_reals(name, value)
    if array.size == 0 and rows == 0:
        return array.reshape(0, 3, 3)
    if array.shape != (rows, 3, 3):
        message = (
            f"{name}: got shape {_shape(array)}; give ({rows},3,3): one frame per correspondence, "
            "its rows the x, y and z axes, NaN for no frame"
        )
        raise InputError(message)
    return array


def real_candidates(name: str, value: ArrayLike, rows: int) -> RealArray:
    """Return `value` as (n,k,3) float32 or float64."""
    array = as_reals(name, value)
    if array.size == 0 and rows == 0:
        return array.reshape(0, 0, 3)
    if array.ndim != 3 or array.shape[0] != rows or array.shape[2] != 3:
        message = (
            f"{name}: got shape {_shape(array)}; give ({rows},k,3): k target points for each correspondence, "
            "the likeliest first"
        )
        raise InputError(message)
    return array


def _shape(array: RealArray) -> str:
    return "(" + ",".join(map(str, array.shape)) + ")"


def as_count(name: str, value: object, least: int) -> int:
    """Return a whole number of at least `least`."""
    if type(value) is int and least <= value <= LARGEST_COUNT:
        return value
    try:
        number = operator.index(value)  # type: ignore[arg-type] # pyright: ignore[reportArgumentType]
    except TypeError:
        number = least - 1
    if isinstance(value, bool) or not least <= number <= LARGEST_COUNT:
        message = f"{name}: got {value!r}; give a whole number of at least {least}"
        raise InputError(message)
    return number


def as_number(name: str, value: object) -> float:
    """Return a real number."""
    if type(value) is float:
        return value
    if isinstance(value, (bool, str)) or np.ndim(value) != 0:  # pyright: ignore[reportArgumentType]
        message = f"{name}: got {value!r}; give a number"
        raise InputError(message)
    try:
        return float(value)  # type: ignore[arg-type] # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError) as error:
        message = f"{name}: got {value!r}; give a number"
        raise InputError(message) from error


def as_length(name: str, value: object) -> float:
    """Return a finite number greater than 0."""
    length = as_number(name, value)
    if not 0 < length < np.inf:
        message = f"{name}: got {length}; give a finite number greater than 0"
        raise InputError(message)
    return length


def as_place(name: str, value: ArrayLike) -> list[float]:
    """Return the three finite coordinates of a point."""
    place = as_floats(name, value)
    if place.shape != (3,) or not np.isfinite(place).all():
        message = f"{name}: got {value!r}; give three finite numbers x, y, z"
        raise InputError(message)
    return place.tolist()
