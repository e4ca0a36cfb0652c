"""Parsers of point cloud files: bytes in, arrays out, any exception for content that can't be parsed.

The core parses all formats but NumPy's own, and LAS and LAZ, for which laspy is loaded where one is to be read.
"""

# laspy isn't typed.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportUnknownMemberType=false, reportMissingImports=false

from __future__ import annotations

import io
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cgroup import _core
from cgroup._options import run_options
from cgroup.errors import InputError
from cgroup.io._numpy_files import load_npy, load_npz_points

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from cgroup.types import FloatArray, IndexArray

_LAS_POINTS = 1_000_000
"""Points that laspy unpacks at a time."""


class CloudContent(NamedTuple):
    """What a file holds; see `cgroup.io.PointCloud`."""

    points: FloatArray
    normals: FloatArray | None = None
    faces: IndexArray | None = None
    colors: NDArray[np.uint8] | None = None


def _parse_in_core(suffix: str, content: bytes) -> CloudContent:
    return CloudContent(*_core.parse_cloud(content, suffix, run_options(threads=1)))


def _parse_npy(content: bytes) -> CloudContent:
    return CloudContent(_points(load_npy(content)))


def _parse_npz(content: bytes) -> CloudContent:
    return CloudContent(_points(load_npz_points(content)))


def _points(array: NDArray[Any]) -> FloatArray:
    if array.ndim != 2 or array.shape[1] != 3:
        message = f"points have shape {array.shape} instead of (N, 3)"
        raise InputError(message)
    return np.asarray(array, dtype=np.float64)


def _parse_las(content: bytes) -> CloudContent:
    import laspy  # noqa: PLC0415 - an extra

    points: list[FloatArray] = []
    colors: list[NDArray[np.uint16]] = []
    try:
        with laspy.open(io.BytesIO(content)) as file:
            has_colors = {"red", "green", "blue"} <= set(file.header.point_format.dimension_names)
            for part in file.chunk_iterator(_LAS_POINTS):
                points.append(np.stack([part.x, part.y, part.z], axis=1).astype(np.float64, copy=False))
                if has_colors:
                    colors.append(np.stack([part.red, part.green, part.blue], axis=1))
            declared = file.header.point_count
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # what a panic of its decompressor becomes isn't an Exception
        raise InputError(str(error) or type(error).__name__) from error
    found = np.concatenate([np.empty((0, 3)), *points])
    if len(found) != declared:
        message = f"{len(found)} of {declared} points"
        raise InputError(message)
    return CloudContent(found, colors=_bytes(np.concatenate(colors)) if colors else None)


def _bytes(colors: NDArray[np.uint16]) -> NDArray[np.uint8]:
    """Colours of 16 bits, as the format has them, or of eight, as some write them."""
    return (colors >> 8 if colors.max(initial=0) > 255 else colors).astype(np.uint8)


_IN_CORE = ("bin", "csv", "obj", "off", "pcd", "ply", "pts", "stl", "txt", "xyz")

PARSERS: dict[str, Callable[[bytes], CloudContent]] = {
    **{f".{name}": partial(_parse_in_core, name) for name in _IN_CORE},
    ".las": _parse_las,
    ".laz": _parse_las,
    ".npy": _parse_npy,
    ".npz": _parse_npz,
}
