"""Convert arguments to arrays of the expected kind, or raise.

Masked arrays are refused, even without masked entries: NumPy's functions drop masks without a warning,
and whether a mask hides something is a matter of the data, not of the program.
"""

from itertools import chain
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup._checks.foreign import ACCEPTED, as_host_array, cloud_parts
from cgroup._checks.quoting import cut, escape, show
from cgroup._checks.values import refusal
from cgroup.errors import InputError, OutOfMemoryError

FloatArray: TypeAlias = NDArray[np.float64]
RealArray: TypeAlias = NDArray[np.float32] | NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IndexArray: TypeAlias = NDArray[np.int64]

_DEEPEST = 5  # lists within lists, beyond which no shape is right anyway
# Types of numbers that the compiled core reads without a conversion
AS_THEY_ARE = (np.dtype(np.float32), np.dtype(np.float64))


def as_floats(name: str, value: ArrayLike) -> FloatArray:
    """Return `value` as a contiguous, aligned float64 array, without a copy if possible."""
    return in_double(as_reals(name, value))


def as_points(name: str, value: object) -> FloatArray:
    """Return `value` as (n,3) float64."""
    return in_double(real_points(name, value))


def finite_points(name: str, value: object) -> FloatArray:
    """Return `value` as (n,3) float64; raise `InputError` if a coordinate is not finite."""
    points = as_points(name, value)
    if not np.isfinite(points).all():
        row = int(np.argmin(np.isfinite(points).all(axis=1)))
        raise InputError(name, f"a coordinate that isn't finite in row {row}", "leave such points out")
    return points


def in_double(array: RealArray) -> FloatArray:
    """Return `array` as float64, without a copy if possible."""
    return array.astype(np.float64, copy=False)


def contiguous(array: NDArray[Any] | None, kind: type[np.generic]) -> Any:  # noqa: ANN401 - of the type
    """Return an array of a type as the core reads it; None for None."""
    return None if array is None else np.ascontiguousarray(array, kind)


def as_array(name: str, value: ArrayLike) -> NDArray[Any]:
    """Return `value` as an array of its own type."""
    if type(value) is np.ndarray:
        return value
    _check_lists(name, value)
    try:
        return np.asarray(as_host_array(name, value))
    except (InputError, MemoryError):
        raise
    except Exception as error:  # whatever the object's own conversion raises
        got = f"{type(value).__name__}, which is no array: {escape(cut(str(error)))}"
        raise InputError(name, got, "give a numpy array of numbers") from error


def _check_lists(name: str, value: object) -> None:
    """Raise for masked arrays, also within lists, and for lists that are nested too deeply."""
    items: Any = (value,)
    for _ in range(_DEEPEST):
        kinds = set(map(type, items))
        if any(issubclass(kind, np.ma.MaskedArray) for kind in kinds):
            raise InputError(name, "a masked array", "drop its masked rows first, then give its `data`")
        lists = {kind for kind in kinds if issubclass(kind, list | tuple)}
        if not lists:
            return
        items = list(chain.from_iterable(items if lists == kinds else [i for i in items if type(i) in lists]))
    raise refusal(name, value, f"give an array of {_DEEPEST - 1} axes at most")


def as_reals(name: str, value: ArrayLike, remedy: str = "give an array of real numbers") -> RealArray:
    """Return `value` as a contiguous, aligned float32 or float64 array, without a copy if possible."""
    array = as_array(name, value)
    if array.dtype.kind not in "fiub":
        raise InputError(name, show(value) if array.ndim == 0 else f"an array of {array.dtype}", remedy)
    if array.dtype in AS_THEY_ARE and array.flags.c_contiguous and array.flags.aligned:
        return array
    # Fields of packed records are neither aligned nor a whole number of elements apart.
    kept = array.dtype if array.dtype in AS_THEY_ARE else np.float64
    try:
        with np.errstate(over="ignore"):  # to infinity, which is refused or not as any other
            return np.require(array, kept, ["C_CONTIGUOUS", "ALIGNED"])
    except MemoryError as error:
        message = f"{name}: no memory for a copy of shape {_shape(array)}; give fewer points"
        raise OutOfMemoryError(message) from error


def real_points(name: str, value: object) -> RealArray:
    """Return `value` as (n,3) float32 or float64: an array, or the points of a foreign cloud or a file."""
    parts = None if type(value) is np.ndarray and value.dtype.names is None else cloud_parts(name, value)
    given: Any = value if parts is None else parts.points
    return _with_three_columns(name, as_reals(name, given, ACCEPTED))


def real_normals(name: str, value: ArrayLike) -> RealArray:
    """Return `value` as (n,3) float32 or float64; clouds and files are not accepted."""
    return _with_three_columns(name, as_reals(name, value, "give (n,3) real numbers, one normal per point"))


def _with_three_columns(name: str, array: RealArray) -> RealArray:
    if array.shape == (0,):
        return array.reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3:
        rows, columns = array.shape if array.ndim == 2 else (0, 0)
        hint = "transpose it" if rows == 3 else "one row of x, y, z per point"
        hint += ", such as cloud[:, :3]" if columns > 3 and rows != 3 else ""
        raise InputError(name, f"shape {_shape(array)}", f"give (n,3): {hint}")
    return array


def real_vector(name: str, value: ArrayLike, rows: int | None) -> RealArray:
    """Return `value` as (n,) float32 or float64, with n = `rows` if `rows` is known."""
    array = as_reals(name, value)
    if array.ndim != 1 or (rows is not None and len(array) != rows):
        expected = "(n,)" if rows is None else f"({rows},)"
        raise InputError(name, f"shape {_shape(array)}", f"give {expected}: one number per correspondence")
    return array


def real_frames(name: str, value: ArrayLike, rows: int) -> RealArray:
    """Return `value` as (n,3,3) float32 or float64; rows of a block are the x, y and z axes."""
    array = as_reals(name, value)
    if array.size == 0 and rows == 0:
        return array.reshape(0, 3, 3)
    if array.shape != (rows, 3, 3):
        form = "one frame per correspondence, its rows the x, y and z axes, NaN for no frame"
        raise InputError(name, f"shape {_shape(array)}", f"give ({rows},3,3): {form}")
    return array


def real_candidates(name: str, value: ArrayLike, rows: int) -> RealArray:
    """Return `value` as (n,k,3) float32 or float64."""
    array = as_reals(name, value)
    if array.size == 0 and rows == 0:
        return array.reshape(0, 0, 3)
    if array.ndim != 3 or array.shape[0] != rows or array.shape[2] != 3:
        form = "k target points for each correspondence, the likeliest first"
        raise InputError(name, f"shape {_shape(array)}", f"give ({rows},k,3): {form}")
    return array


def _shape(array: RealArray) -> str:
    return "(" + ",".join(map(str, array.shape)) + ")"


def as_place(name: str, value: ArrayLike) -> list[float]:
    """Return the three finite coordinates of a point."""
    place = as_floats(name, value)
    if place.shape != (3,) or not np.isfinite(place).all():
        raise refusal(name, value, "give three finite numbers x, y, z")
    return place.tolist()


def as_direction(name: str, value: ArrayLike, example: str) -> FloatArray:
    """Return a direction as a unit vector."""
    direction = np.array(as_place(name, value))
    largest = float(np.abs(direction).max())
    if largest == 0:
        raise InputError(name, "a zero vector", f"give a direction such as {example}")
    direction /= largest  # squares of the largest numbers are infinite, of the least zero
    return direction / np.linalg.norm(direction)


def as_rows(name: str, value: ArrayLike) -> IndexArray:
    """Return `value` as (m,) int64, rows of a cloud."""
    array = as_array(name, value)
    if array.size == 0 and array.ndim <= 1:
        return np.empty(0, dtype=np.int64)
    if array.dtype.kind not in "iu" or array.ndim != 1:
        raise _not_whole(name, value, array, "give (m,) whole numbers, rows of `points`")
    return _as_indices(name, array)


def as_faces(name: str, value: ArrayLike) -> IndexArray:
    """Return `value` as (F,3) int64, rows of a cloud."""
    array = as_array(name, value)
    if array.size == 0 and array.dtype.kind in "iuf":
        return np.empty((0, 3), dtype=np.int64)
    if array.dtype.kind not in "iu" or array.ndim != 2 or array.shape[1] != 3:
        raise _not_whole(name, value, array, "give (F,3) whole numbers, rows of `points`")
    return _as_indices(name, array)


def as_colors(value: object, count: int) -> NDArray[np.uint8] | None:
    """Return the colours of a number of points as bytes, from bytes or fractions; None for other values."""
    try:
        colors = np.asarray(as_host_array("colors", value))
    except Exception:  # noqa: BLE001 - whatever the object's own conversion raises
        return None
    if colors.ndim != 2 or len(colors) != count or count == 0 or colors.shape[1] not in (3, 4):
        return None
    if colors.dtype.kind == "f" and ((colors >= 0) & (colors <= 1)).all():
        colors = np.rint(255 * colors).astype(np.uint8)
    return colors[:, :3] if colors.dtype == np.uint8 else None


def as_mask(name: str, value: ArrayLike) -> BoolArray:
    """Return `value` as (n,) bool."""
    array = as_array(name, value)
    if array.ndim != 1 or (array.size and array.dtype != bool):
        raise _not_whole(name, value, array, "give a vector of bool")
    return array.astype(bool, copy=False)


def _not_whole(name: str, value: ArrayLike, array: NDArray[Any], remedy: str) -> InputError:
    if array.ndim == 0:
        return refusal(name, value, remedy)
    return InputError(f"{name}: got shape {_shape(array)} of {array.dtype}; {remedy}")


def _as_indices(name: str, array: NDArray[Any]) -> IndexArray:
    if (array < 0).any():
        row = np.unravel_index(int(np.argmax(array < 0)), array.shape)
        raise InputError(name, f"index {array[row]} in row {row[0]}", "give rows of `points`, counted from 0")
    if array.dtype == np.uint64 and (array >= 2**63).any():
        raise InputError(name, f"index {array.max()}", "give rows of `points`, counted from 0")
    return np.ascontiguousarray(array, dtype=np.int64)
