"""Parsers of point cloud files: bytes in, arrays out, any exception for content that can't be parsed.

The core parses all formats but NumPy's own, and LAS and LAZ, for which laspy is loaded where it is needed.
"""

from __future__ import annotations

import io
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cgroup import _core
from cgroup._checks.run_options import run_options
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

    parts: list[tuple[FloatArray, NDArray[np.uint16] | None]] = []
    try:
        with laspy.open(io.BytesIO(content)) as file:
            declared = file.header.point_count
            has_colors = {"red", "green", "blue"} <= set(file.header.point_format.dimension_names)
            parts += [_las_part(part, has_colors) for part in file.chunk_iterator(_LAS_POINTS)]
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # what a panic of its decompressor becomes isn't an Exception
        raise InputError(str(error) or type(error).__name__) from error
    points = np.concatenate([np.empty((0, 3)), *(part[0] for part in parts)])
    if len(points) != declared:
        message = f"{len(points)} of {declared} points"
        raise InputError(message)
    colors = [part[1] for part in parts if part[1] is not None]
    return CloudContent(points, colors=_bytes(np.concatenate(colors)) if colors else None)


def _las_part(part: Any, has_colors: bool) -> tuple[FloatArray, NDArray[np.uint16] | None]:  # noqa: ANN401, FBT001 - laspy's
    points = np.stack([np.asarray(part[name], dtype=np.float64) for name in "xyz"], axis=1)
    if not has_colors:
        return points, None
    return points, np.stack([np.asarray(part[name]) for name in ("red", "green", "blue")], axis=1)


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
