"""Read and write rigid transforms."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup._checks.values import as_path
from cgroup.errors import InputError
from cgroup.io._files import load_numbers, parse_file, write_file
from cgroup.io._numpy_files import load_npy, npy_bytes
from cgroup.io._poses import find_poses
from cgroup.rigid import check_rigid

if TYPE_CHECKING:
    import os

    from numpy.typing import ArrayLike, NDArray

    from cgroup.types import FloatArray

_BRACKETS = bytes.maketrans(b"[](){}", b"      ")


def read_transform(path: str | os.PathLike[str]) -> FloatArray:
    """Read a rigid transform of column vectors, in any of the usual notations.

    Parameters
    ----------
    path : path-like
        ``.npy``, ``.json``, or text of any suffix (``.txt``, ``.xf``): numbers separated by white space,
        commas, semicolons or brackets; # and // start comments. They are the 4 rows of a 4x4 matrix, or its
        first 3; 16 or 12 numbers row by row (as KITTI writes poses); ``tx ty tz qx qy qz qw``, a translation
        and a unit quaternion; or these after a time (as TUM writes them).

    Returns
    -------
    (4,4) array of float64
        The transform.

    Raises
    ------
    InputError
        If the file is missing or unreadable, holds several poses, or no rigid transform: numbers column by
        column are refused, and quaternions whose length is not 1.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from cgroup.io import read_transform
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "pose.txt")
    ...     path.write_text("0.5, 0, 2,  0, 0, 0, 1  # tx ty tz qx qy qz qw")
    ...     read_transform(path)
    46
    array([[1. , 0. , 0. , 0.5],
           [0. , 1. , 0. , 0. ],
           [0. , 0. , 1. , 2. ],
           [0. , 0. , 0. , 1. ]])
    """
    poses = read_transforms(path)
    if len(poses) > 1:
        message = f"{path}: holds {len(poses)} poses; give a file with one of them"
        raise InputError(message)
    return poses[0]


def read_transforms(path: str | os.PathLike[str]) -> FloatArray:
    r"""Read all poses of a file, such as a trajectory of KITTI or TUM.

    Parameters
    ----------
    path : path-like
        ``.npy``, ``.json``, or text of any suffix: one pose per row, as 16 or 12 numbers row by row (as KITTI
        writes them), as ``tx ty tz qx qy qz qw``, or as these after a time (as TUM writes them); or 4x4
        matrices below each other, or a JSON list or NumPy array of matrices.

    Returns
    -------
    (m,4,4) array of float64
        In the file's order, without times.

    Raises
    ------
    InputError
        If the file is missing or unreadable, or a pose isn't rigid; poses count from 1.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from cgroup.io import read_transforms
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "trajectory.txt")
    ...     written = path.write_text("1.0 0 0 0 0 0 0 1\n1.1 0.5 0 0 0 0 0 1\n")
    ...     read_transforms(path)[:, :3, 3]
    array([[0. , 0. , 0. ],
           [0.5, 0. , 0. ]])
    """
    path = as_path("path", path)
    reader = {".npy": load_npy, ".json": _load_json}.get(path.suffix.lower(), _load_text)
    return find_poses(str(path), parse_file(path, reader))


def _load_text(content: bytes) -> NDArray[Any]:
    if content.lstrip()[:1] in (b"[", b"{"):
        try:
            return _load_json(content)
        except json.JSONDecodeError:
            # As NumPy prints arrays, whose rows may take several lines.
            content = content.replace(b"\n", b" ").replace(b"]", b"\n")
    return load_numbers(content.translate(_BRACKETS))


def _load_json(content: bytes) -> NDArray[Any]:
    """Read lists of numbers, or the only ones of an object."""
    value = json.loads(content)
    if isinstance(value, dict):
        lists = [entry for entry in value.values() if isinstance(entry, list)]
        if len(lists) != 1:
            message = f"{len(lists)} of its entries are lists; one is to be, that of the pose's numbers"
            raise InputError(message)
        value = lists[0]
    try:
        array = np.asarray(value)
    except ValueError as error:
        message = "its lists are of unequal lengths"
        raise InputError(message) from error
    if array.dtype.kind not in "iuf":
        message = "its lists hold something else than numbers"
        raise InputError(message)
    return array


def write_transform(path: str | os.PathLike[str], transform: ArrayLike) -> None:
    """Write a 4x4 rigid transform, exact to the last bit.

    Parameters
    ----------
    path : path-like
        ``.npy``, or text of any other suffix.
    transform : (4,4) or (3,4) array_like of float
        Rotation and translation.

    Raises
    ------
    InputError
        If it isn't rigid, or the file can't be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> from cgroup.io import write_transform
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "pose.txt")
    ...     write_transform(path, np.eye(4))
    ...     path.read_text().splitlines()[0]
    '1.0 0.0 0.0 0.0'
    """
    path = as_path("path", path)
    matrix = check_rigid(transform)
    if path.suffix.lower() == ".npy":
        write_file(path, npy_bytes(matrix))
    else:
        rows = (" ".join(repr(float(number)) for number in row) for row in matrix)
        write_file(path, ("\n".join(rows) + "\n").encode())
