"""Models of COLMAP, in text or binary, moved with all that they hold (https://colmap.github.io/format.html).

Of each file the content is kept; a move replaces the numbers of positions and poses in it.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup._checks.values import as_instance, as_length, as_path
from cgroup.errors import InputError
from cgroup.io.files import new_folder, parse_file
from cgroup.io.transforms import from_quaternions
from cgroup.rigid import apply, check_rigid, invert
from cgroup.rigid.transforms import quaternions
from cgroup.types import FloatArray, PointCloud

_NEEDED, _OPTIONAL = ("cameras", "images", "points3D"), ("rigs", "frames")
_POINT = np.dtype([("xyz", "<f8", 3), ("rgb", "u1", 3), ("error", "<f8")])
_FIRST = {"points3D": (1, 8), "images": (1, 4), "frames": (2, 8)}  # word and byte of the numbers in a record
_WIDTH = 7  # numbers of a pose, qw qx qy qz tx ty tz, and of a point, x y z r g b and its error


@dataclass(frozen=True)
class _File:
    """The content of a file, the line and word (n,2) or byte (n,) of each row of numbers, and these."""

    content: bytes
    places: NDArray[np.int64]
    numbers: FloatArray

    def filled(self, numbers: FloatArray) -> _File:
        """Replace the first columns."""
        changed = np.concatenate([numbers, self.numbers[:, numbers.shape[1] :]], axis=1)
        if self.places.ndim == 1:
            content = bytearray(self.content)
            kind = np.dtype([("numbers", "<f8", numbers.shape[1:])])
            _records(content, kind)["numbers"][self.places] = numbers
            return replace(self, content=bytes(content), numbers=changed)
        lines = self.content.split(b"\n")
        for (row, first), values in zip(self.places.tolist(), numbers.tolist(), strict=True):
            words = lines[row].split(None, first + len(values))
            words[first : first + len(values)] = (repr(value).encode() for value in values)
            lines[row] = b" ".join(words)
        return replace(self, content=b"\n".join(lines), numbers=changed)


@dataclass(frozen=True, eq=False)
class ColmapModel:
    """A reconstruction of COLMAP, also a cloud for `register`; see `read_colmap`.

    Attributes
    ----------
    points : (N,3) array of float64
        Triangulated points, in the model's unit.
    colors : (N,3) array of uint8
        Red, green, blue.
    errors : (N,) array of float64
        Mean reprojection error of each point in pixels; COLMAP writes -1 for unknown.
    image_names : tuple of str
        Names of the m images.
    T_camera_world : (m,4,4) array of float64
        Pose of each image: it maps points of the model into the camera's frame.
    """

    points: FloatArray
    colors: NDArray[np.uint8]
    errors: FloatArray
    image_names: tuple[str, ...]
    T_camera_world: FloatArray
    _files: dict[str, _File] = field(repr=False)

    def transformed(self, pose: ArrayLike, scale: float = 1.0) -> ColmapModel:
        """Move the model by a similarity: p' = scale R p + t.

        Parameters
        ----------
        pose : (4,4) array_like of float
            Rotation and translation.
        scale : float
            Length of the model's unit in that of the result.

        Returns
        -------
        ColmapModel
            Moved points, and poses of images, frames and rigs; all else, such as cameras, tracks and 2D
            points, is unchanged to the bit.
        """
        matrix, scale = check_rigid(pose, "pose"), as_length("scale", scale)
        files = dict(self._files)
        for name, file in self._files.items():
            part, numbers = name.partition(".")[0], file.numbers.copy()
            if part == "points3D":
                files[name] = file.filled(apply(matrix, scale * numbers[:, :3]))
            elif part != "cameras":
                numbers[:, 4:] *= scale
                if part != "rigs":  # poses of sensors in their rig
                    moved = _poses(numbers) @ invert(matrix)
                    numbers[:, :4] = quaternions(moved[:, :3, :3])[:, [3, 0, 1, 2]]
                    numbers[:, 4:] = moved[:, :3, 3]
                files[name] = file.filled(numbers)
        return _model(files)


def read_colmap(folder: str | os.PathLike[str]) -> ColmapModel:
    r"""Read a model of COLMAP.

    Parameters
    ----------
    folder : path-like
        With cameras, images and points3D, all as ``.bin`` or all as ``.txt``; and rigs and frames, if any.

    Returns
    -------
    ColmapModel
        Points, and poses of the images.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.io import read_colmap
    >>> Path("sparse").mkdir()
    >>> _ = Path("sparse/cameras.txt").write_text("1 PINHOLE 40 30 20 20 20 15")
    >>> _ = Path("sparse/images.txt").write_text("1 1 0 0 0 0 0 4 1 a.png\n")
    >>> _ = Path("sparse/points3D.txt").write_text("1 1 2 3 90 90 90 0.5 1 0")
    >>> read_colmap("sparse").points.tolist()
    [[1.0, 2.0, 3.0]]
    """
    folder = as_path("folder", folder)
    for suffix in (".bin", ".txt"):
        if all((folder / f"{part}{suffix}").is_file() for part in _NEEDED):
            paths = [folder / f"{part}{suffix}" for part in (*_NEEDED, *_OPTIONAL)]
            return _model(
                {path.name: parse_file(path, partial(_parse, path.name)) for path in paths if path.is_file()}
            )
    raise InputError(f"{folder}: no model of COLMAP; it has {', '.join(_NEEDED)} as .bin or as .txt")


def write_colmap(folder: str | os.PathLike[str], model: ColmapModel) -> None:
    """Write a model of COLMAP, in the format in which it was read.

    Parameters
    ----------
    folder : path-like
        A new folder, which appears when it is complete.
    model : ColmapModel
        Read by `read_colmap`.

    Examples
    --------
    >>> from cgroup.io import read_colmap, write_colmap
    >>> model = read_colmap("sparse")  # of the example of `read_colmap`
    >>> turned = [[-1.0, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]
    >>> write_colmap("turned", model.transformed(turned, scale=2))
    >>> read_colmap("turned").points.tolist()
    [[-2.0, -4.0, 11.0]]
    """
    files = as_instance("model", model, ColmapModel)._files  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
    with new_folder(as_path("folder", folder)) as made:
        for name, file in files.items():
            (made / name).write_bytes(file.content)


def parse_points(suffix: str, content: bytes) -> PointCloud:
    """Parse points3D.txt or points3D.bin."""
    numbers = _parse(f"points3D{suffix}", content).numbers
    return PointCloud(numbers[:, :3], colors=numbers[:, 3:6].astype(np.uint8))


def _poses(numbers: FloatArray) -> FloatArray:
    return from_quaternions("poses", numbers[:, [4, 5, 6, 1, 2, 3, 0]])


def _model(files: dict[str, _File]) -> ColmapModel:
    _, images, points = (file for name, file in files.items() if name.partition(".")[0] in _NEEDED)
    if images.places.ndim == 1:
        starts = (images.places + 60).tolist()  # behind the pose and the camera
        names = [images.content[at : images.content.index(b"\0", at)] for at in starts]
    else:
        lines = images.content.split(b"\n")
        names = [lines[row].split(None, 9)[9].rstrip() for row in images.places[:, 0].tolist()]
    words, numbers = tuple(name.decode(errors="replace") for name in names), points.numbers
    colors = numbers[:, 3:6].astype(np.uint8)
    return ColmapModel(numbers[:, :3], colors, numbers[:, 6], words, _poses(images.numbers), files)


def _parse(name: str, content: bytes) -> _File:
    """Find and check the numbers of a file."""
    part, _, suffix = name.partition(".")
    places, numbers = np.empty(0, np.int64), np.empty((0, _WIDTH))
    if part == "cameras":
        return _File(content, places, numbers)
    if suffix == "bin":
        places = np.fromiter(_binary_places(part, content), np.int64)
        kind = _POINT if part == "points3D" else np.dtype([("pose", "<f8", _WIDTH)])
        rows = _records(content, kind)[places]
        numbers = np.column_stack([rows[each] for each in kind.names or ()]).astype(np.float64)
    else:
        lines = content.split(b"\n")
        places = np.array([*_text_places(part, lines)], np.int64).reshape(-1, 2)
        words = [lines[row].split(None, at + _WIDTH)[at : at + _WIDTH] for row, at in places.tolist()]
        if part == "images" and any(len(lines[row].split(None, 9)) < 10 for row in places[:, 0]):
            raise InputError("an image without a name")
        numbers = np.array(words, np.float64).reshape(len(words), _WIDTH)
    if part != "points3D":
        _poses(numbers)
    elif not ((numbers[:, 3:6] >= 0) & (numbers[:, 3:6] < 256)).all():
        raise InputError("a colour that is not from 0 to 255")
    return _File(content, places, numbers)


def _records(content: bytes | bytearray, kind: np.dtype[Any]) -> NDArray[Any]:
    """Return a view of the content as records that begin at each byte."""
    return np.ndarray(max(len(content) - kind.itemsize + 1, 0), kind, content, strides=(1,))


def _binary_places(part: str, content: bytes) -> Iterator[int]:
    """Yield the byte where the numbers of each record begin; the last record must end the file."""
    (count,), at = struct.unpack_from("<Q", content), 8
    for _ in range(count):
        if part == "rigs":
            sensors = struct.unpack_from("<4xI", content, at)[0]
            at += 16 if sensors else 8  # of which the first has no pose
            for _ in range(1, sensors):
                if content[at + 8]:
                    yield at + 9
                at += 65 if content[at + 8] else 9
            continue
        yield at + _FIRST[part][1]
        if part == "frames":
            at += 68 + 16 * struct.unpack_from("<I", content, at + 64)[0]
        else:
            end = content.index(b"\0", at + 64) + 1 if part == "images" else at + 43
            at = end + 8 + (24 if part == "images" else 8) * struct.unpack_from("<Q", content, end)[0]
    if at != len(content):
        raise InputError(f"{len(content)} bytes, but its records have {at}")


def _text_places(part: str, lines: list[bytes]) -> Iterator[tuple[int, int]]:
    """Yield the line, and the word in it, where the numbers of each record begin."""
    rows = iter(range(len(lines)))
    for row in rows:
        words = lines[row].split(None, -1 if part == "rigs" else 1)
        if not words or words[0].startswith(b"#"):
            continue
        if part in _FIRST:
            yield row, _FIRST[part][0]
        if part == "images":
            next(rows, None)  # its 2D points, if any
        at = 4
        while part == "rigs" and at < len(words):
            if words[at + 2] == b"1":
                yield row, at + 3
            at += 10 if words[at + 2] == b"1" else 3
