"""Models of COLMAP, in text or binary, moved with all that they hold (https://colmap.github.io/format.html).

Of each file the content is kept; a move replaces the numbers of positions and poses in it.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup import _core
from cgroup._checks.values import as_instance, as_length, as_path
from cgroup.errors import InputError
from cgroup.io.files import faults_of, new_folder, parse_file
from cgroup.io.transforms import from_quaternions
from cgroup.rigid import apply, check_rigid, invert
from cgroup.rigid.transforms import quaternions
from cgroup.types import FloatArray, PointCloud

_NEEDED, _OPTIONAL = ("cameras", "images", "points3D"), ("rigs", "frames")


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
    _files: dict[str, _core.ColmapFile] = field(repr=False)

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
        files = {}
        for name, file in self._files.items():
            numbers = file.numbers()
            if name.startswith("points3D"):
                numbers = apply(matrix, scale * numbers[:, :3])
            else:
                numbers[:, 4:] *= scale
            if name.startswith(("images", "frames")):  # those of rigs are poses of sensors in their rig
                moved = _poses(numbers) @ invert(matrix)
                numbers = np.hstack([quaternions(moved[:, :3, :3])[:, [3, 0, 1, 2]], moved[:, :3, 3]])
            files[name] = file.replaced(numbers)
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
            return _model({path.name: _read(path) for path in paths if path.is_file()})
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
            (made / name).write_bytes(file.content())


def parse_points(suffix: str, content: bytes) -> PointCloud:
    """Parse points3D.txt or points3D.bin."""
    numbers = _core.ColmapFile(f"points3D{suffix}", content).numbers()
    return PointCloud(numbers[:, :3], colors=numbers[:, 3:6].astype(np.uint8))


def _read(path: Path) -> _core.ColmapFile:
    """Find the numbers of a file, and check its poses."""
    file = parse_file(path, partial(_core.ColmapFile, path.name))
    if path.stem != "points3D":
        with faults_of(path):
            if not np.isfinite(_poses(file.numbers())).all():
                raise InputError("a pose that is not finite")
    return file


def _poses(numbers: FloatArray) -> FloatArray:
    return from_quaternions("poses", numbers[:, [4, 5, 6, 1, 2, 3, 0]])


def _model(files: dict[str, _core.ColmapFile]) -> ColmapModel:
    _, images, points = (file for name, file in files.items() if name.partition(".")[0] in _NEEDED)
    numbers, names = points.numbers(), tuple(images.image_names())
    colors = numbers[:, 3:6].astype(np.uint8)
    return ColmapModel(numbers[:, :3], colors, numbers[:, 6], names, _poses(images.numbers()), files)
