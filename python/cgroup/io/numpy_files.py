"""NPY and NPZ: declared sizes are checked first, and only requested arrays are unpacked."""

import io
import math
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import ArrayLike, NDArray

from cgroup._checks.arrays import as_array
from cgroup._checks.quoting import escape
from cgroup.errors import InputError
from cgroup.io.files import check_growth, parse_file, write_file

_KINDS = "biuf"  # numbers and truth values; others are records, texts, dates or pickled objects


def write_array(path: Path, array: NDArray[Any], lines: Iterable[str]) -> None:
    """Write an array as NPY if the suffix is .npy, otherwise the lines of a text."""
    if path.suffix.lower() != ".npy":
        write_file(path, "".join(f"{line}\n" for line in lines).encode())
        return
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    write_file(path, buffer.getvalue())


def npz_bytes(**arrays: ArrayLike) -> bytes:
    """Return the content of a compressed NPZ file."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, **arrays)
    return buffer.getvalue()


def load_npy(content: bytes, *, records: bool = False) -> NDArray[Any]:
    """Read a NumPy array of numbers, optionally of records."""
    return _read_array(io.BytesIO(content), len(content), _KINDS + "V" * records)


def read_arrays(
    path: Path, needed: Iterable[str] = (), optional: Iterable[str] = (), *, texts: bool = False
) -> dict[str, NDArray[Any]]:
    """Read arrays of numbers or texts from an NPZ file: needed ones, and optional ones if available."""
    needed = list(needed)

    def load(content: bytes) -> tuple[list[str], dict[str, NDArray[Any]]]:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = _entries(archive)
            wanted = [name for name in [*needed, *optional] if name in entries]
            if not entries.keys() >= set(needed):
                wanted = []
            kinds = _KINDS + "U" * texts
            return sorted(entries), {name: _unpack(archive, name, entries[name], kinds) for name in wanted}

    found, arrays = parse_file(path, load)
    lacking = next((name for name in needed if name not in found), None)
    if lacking is not None:
        raise InputError(f"{path}: has no array {lacking!r}; it holds {escape(_listed(found))}")
    return arrays


def load_npz_points(content: bytes) -> NDArray[Any]:
    """Read the array `points` or `xyz` of an NPZ file, or else `x`, `y` and `z`, or the only one."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        entries = _entries(archive)
        axes = {name.casefold(): name for name in entries if name in [*"xyzXYZ"]}
        if len(axes) == 3 and not entries.keys() & {"points", "xyz"}:
            return np.stack([_unpack(archive, axes[axis], entries[axes[axis]]) for axis in "xyz"], axis=1)
        names = [name for name in ("points", "xyz") if name in entries] or list(entries)
        if not names or (len(names) > 1 and names[0] != "points"):
            raise InputError(f"has no array named points or xyz, nor x, y and z; it holds {_listed(entries)}")
        return _unpack(archive, names[0], entries[names[0]], _KINDS + "V")


def _entries(archive: zipfile.ZipFile) -> dict[str, zipfile.ZipInfo]:
    return {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}


def _listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "nothing"


def _unpack(archive: zipfile.ZipFile, name: str, entry: zipfile.ZipInfo, kinds: str = _KINDS) -> NDArray[Any]:
    remedy = "; write one that large without compression, by numpy.savez"
    check_growth(f"array {name!r}", entry.file_size, entry.compress_size, remedy)
    with archive.open(entry) as file:
        return _read_array(file, entry.file_size, kinds)


def _read_array(file: IO[bytes], size: int, kinds: str = _KINDS) -> NDArray[Any]:
    version = npy_format.read_magic(file)
    readers = {(1, 0): npy_format.read_array_header_1_0, (2, 0): npy_format.read_array_header_2_0}
    if version not in readers:
        raise InputError(f"an array in version {version} of its format; numbers are written in 1.0 or 2.0")
    shape, _, dtype = readers[version](file)
    if dtype.kind not in kinds or dtype.hasobject or (dtype.kind == "V" and not dtype.names):
        raise InputError(f"an array of {dtype}; numbers belong there")
    if dtype.itemsize == 0:
        raise InputError(f"an array of {dtype}, which takes no room")
    needed, rest = math.prod(shape) * dtype.itemsize, size - file.tell()
    if needed > rest or min(shape, default=0) < 0:
        raise InputError(f"an array of shape {shape} takes {needed} bytes, and {rest} are there")
    file.seek(0)
    return npy_format.read_array(file, allow_pickle=False)


def single_number(path: Path, value: ArrayLike) -> float:
    """Return the resolution in a file; raise unless it is one number."""
    array = as_array("resolution", value)
    if array.size != 1 or array.dtype.kind not in "fiu":
        raise InputError(
            f"{path}: resolution has shape {array.shape} of {array.dtype}; it is a single number"
        )
    return float(array.reshape(()))
