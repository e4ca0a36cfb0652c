"""What all files have in common: reading, writing, and errors that name the file."""

from __future__ import annotations

import io
import re
import warnings
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from cgroup._arguments import as_array
from cgroup._values import as_instance, as_path
from cgroup.errors import InputError

if TYPE_CHECKING:
    import os
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    from cgroup.types import FloatArray

Result = TypeVar("Result")


def write_file(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file, or raise `InputError` with the system's reason."""
    path, content = as_path("path", path), as_instance("content", content, bytes)
    try:
        path.write_bytes(content)
    except (OSError, UnicodeEncodeError) as error:
        reason = error.strerror or error if isinstance(error, OSError) else "no such file name"
        message = f"{path}: can't be written ({reason})"
        raise InputError(message) from error


def _read_content(path: Path) -> bytes:
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        message = f"{path}: no such file"
    except IsADirectoryError:
        message = f"{path}: is a directory, not a file"
    except UnicodeEncodeError:
        message = f"{path}: no such file"
    except OSError as error:
        message = f"{path}: can't be read ({error.strerror or error})"
    else:
        if content:
            return content
        message = f"{path}: the file is empty"
    raise InputError(message) from None


def parse_file(path: Path, parse: Callable[[bytes], Result]) -> Result:
    """Parse the file; whatever a parser stumbles over becomes one error that names the file."""
    content = _read_content(path)
    try:
        with warnings.catch_warnings():
            # NumPy only warns where a line of numbers goes on with something else.
            warnings.filterwarnings("error", message="string or file could not be read")
            return parse(content)
    except ModuleNotFoundError as error:
        message = f"{path}: reading it needs {error.name}; pip install 'cgroup[scans]'"
        raise InputError(message) from error
    except MemoryError:
        raise
    except Exception as error:
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        kind = path.suffix.lstrip(".").upper() or "text"
        message = f"{path}: not a readable {kind} file, or cut off ({reason})"
        raise InputError(message) from error


def read_arrays(path: Path, *needed: str) -> dict[str, NDArray[Any]]:
    """Read an NPZ file that has to hold the arrays needed."""
    arrays = parse_file(path, load_npz)
    missing = [name for name in needed if name not in arrays]
    if missing:
        found = ", ".join(sorted(arrays)) or "nothing"
        message = f"{path}: has no array {missing[0]!r}; it holds {found}"
        raise InputError(message)
    return arrays


def single_number(path: Path, value: ArrayLike) -> float:
    array = as_array("resolution", value)
    if array.size != 1 or array.dtype.kind not in "fiu":
        message = f"{path}: resolution has shape {array.shape} of {array.dtype}; it is a single number"
        raise InputError(message)
    return float(array.reshape(()))


def npy_bytes(array: NDArray[Any]) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def npz_bytes(**arrays: ArrayLike) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def load_npz(content: bytes) -> dict[str, NDArray[Any]]:
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return dict(archive)


def load_numbers(content: bytes) -> FloatArray:
    """Read rows of numbers, separated by white space, commas or semicolons; # and // start comments."""
    text = re.sub("[,;]", " ", content.decode())
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*input contained no data")
        return np.loadtxt(io.StringIO(text), dtype=np.float64, comments=("#", "//"), ndmin=2)


def load_npy(content: bytes) -> NDArray[Any]:
    """Read a NumPy array; pickled objects are refused."""
    return np.load(io.BytesIO(content), allow_pickle=False)
