"""Read depth images."""

from __future__ import annotations

import io
import os
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup._checks.arrays import as_floats
from cgroup._checks.values import as_length, as_path
from cgroup.errors import InputError
from cgroup.io.files import check_growth, parse_file
from cgroup.io.numpy_files import load_npy
from cgroup.types import PointCloud

_MOST_PIXELS = 1 << 26
_MILLIMETRES = 1000.0


def read_depth(
    path: str | os.PathLike[str], intrinsics: ArrayLike, *, scale: float | None = None
) -> PointCloud:
    """Read a depth image as a point cloud in the camera's frame.

    x is to the right, y down, z forward: the pixel in column u and row v that shows the depth d becomes
    ((u - cx) d / fx, (v - cy) d / fy, d). Whole numbers are the centres of pixels; there is no distortion.
    Pixels of depth 0 or less, NaN and infinity are no readings: they are left out and counted in
    `PointCloud.dropped`.

    Parameters
    ----------
    path : path-like
        ``.png`` of one channel of 16 bits, which needs the extra ``cgroup[scans]``; or ``.npy`` with an
        (height, width) array.
    intrinsics : (4,) or (3,3) array_like of float
        fx, fy, cx, cy of the pinhole camera in pixels, or the camera matrix.
    scale : float, optional
        Value in the file for a depth of 1: 1000 for millimetres, the default for whole
        numbers; 5000 in the data sets of TUM. 1 is the default for real numbers.

    Returns
    -------
    PointCloud
        Points row by row; `PointCloud.viewpoint` is the camera, the origin.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.io import read_depth
    >>> np.save("depth.npy", np.array([[0, 2000], [1000, 1000]], np.uint16))
    >>> cloud = read_depth("depth.npy", (500, 500, 0.5, 0.5))
    >>> cloud.points[0].tolist(), cloud.dropped
    ([0.002, -0.002, 2.0], 1)
    """
    path = as_path("path", path)
    fx, fy, cx, cy = _pinhole(intrinsics)
    divisor = None if scale is None else as_length("scale", scale)
    readers = {".png": _parse_png, ".npy": load_npy}
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: depth images are read from {' and '.join(readers)}")
    image = parse_file(path, readers[path.suffix.lower()])
    if image.ndim != 2:
        raise InputError(f"{path}: shape {image.shape}; a depth image has (height, width)")
    if divisor is None:
        divisor = 1.0 if image.dtype.kind == "f" else _MILLIMETRES
    rows, columns = np.nonzero(np.isfinite(image) & (image > 0))
    with np.errstate(over="ignore", invalid="ignore"):  # points beyond the range of numbers are dropped
        z = image[rows, columns] / divisor
        points = np.stack([(columns - cx) * z / fx, (rows - cy) * z / fy, z], axis=1)
    points = points[np.isfinite(points).all(axis=1)]
    if len(points) == 0:
        raise InputError(f"{path}: none of its {image.size} pixels has a depth")
    return PointCloud(points, dropped=image.size - len(points), viewpoint=np.zeros(3))


def _pinhole(intrinsics: ArrayLike) -> tuple[float, float, float, float]:
    given = as_floats("intrinsics", intrinsics)
    if given.shape == (3, 3) and given[0, 1] == given[1, 0] == 0 and given[2].tolist() == [0, 0, 1]:
        given = given[[0, 1, 0, 1], [0, 1, 2, 2]]
    if given.shape != (4,) or not np.isfinite(given).all() or given[:2].min() <= 0:
        raise InputError(
            "intrinsics",
            str(given.tolist()) if given.size <= 9 else f"shape {given.shape}",
            "give fx, fy, cx, cy in pixels, or the camera matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]",
        )
    fx, fy, cx, cy = given.tolist()
    return fx, fy, cx, cy


def _parse_png(content: bytes) -> NDArray[Any]:
    """Return the pixels of an image of 16 bits; its size is checked before it is unpacked."""
    if content[:8] != b"\x89PNG\r\n\x1a\n":
        raise InputError("doesn't begin as a PNG file")
    width, height, bits, kind = struct.unpack_from(">IIBB", content, 16)
    if (bits, kind) != (16, 0):
        raise InputError(f"{bits} bits of colour type {kind}; a depth image has one channel of 16 bits")
    check_growth("its pixels", 8 * width * height, len(content))
    if width * height > _MOST_PIXELS:
        raise InputError(f"{width} x {height} pixels; at most {_MOST_PIXELS} are read")
    _check_chunks(content)
    from PIL import Image  # noqa: PLC0415 - an extra

    with Image.open(io.BytesIO(content), formats=["PNG"]) as image:
        if image.size != (width, height):
            found = f"{image.width} x {image.height}"
            raise InputError(f"its header has {width} x {height} pixels, its content {found}")
        return np.asarray(image)


def _check_chunks(content: bytes) -> None:
    """Compare the checksums of all chunks, since Pillow does not check chunks of pixels."""
    place, name = 8, b""
    while name != b"IEND":
        length, name = struct.unpack_from(">I4s", content, place)
        (checksum,) = struct.unpack_from(">I", content, place + 8 + length)
        if zlib.crc32(content[place + 4 : place + 8 + length]) != checksum:
            raise InputError(
                f"the data at byte {place} do not match their checksum: the file is damaged, copy it again"
            )
        place += 12 + length
