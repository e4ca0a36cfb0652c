"""Read and write rigid transforms, one by one or in Redwood's lists of pairs (``gt.log``, ``gt.info``)."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup._checks.arrays import as_floats
from cgroup._checks.values import as_path
from cgroup.errors import InputError
from cgroup.io.files import load_json, load_numbers, load_text, number_lines, parse_file, read_content
from cgroup.io.numpy_files import load_npy, write_array
from cgroup.rigid import RIGID_TOLERANCE, check_rigid
from cgroup.rigid.transforms import are_rigid, turn
from cgroup.types import FloatArray, IndexArray

_NOTATIONS = (
    "a pose is 4 rows of 4 numbers, or 3 of 4; 16 or 12 numbers, row by row; tx ty tz qx qy qz qw; "
    "or these after a time"
)

_CLOUDS = {".e57", ".glb", ".gltf", ".las", ".laz", ".obj", ".off", ".pcd", ".ply", ".ptx", ".stl", ".vtk"}
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

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.io import read_transform
    >>> _ = Path("pose.txt").write_text("0.5, 0, 2, 0, 0, 0, 1  # t, q")
    >>> read_transform("pose.txt")[:3]
    array([[1. , 0. , 0. , 0.5],
           [0. , 1. , 0. , 0. ],
           [0. , 0. , 1. , 2. ]])
    """
    poses = read_transforms(path)
    if len(poses) > 1:
        raise InputError(f"{path}: holds {len(poses)} poses; give a file with one of them")
    return poses[0]


def read_transforms(path: str | os.PathLike[str]) -> FloatArray:
    r"""Read all poses of a file, such as a trajectory of KITTI or TUM.

    Parameters
    ----------
    path : path-like
        As for `read_transform`: one pose per row, or 4x4 matrices below each other, in a JSON list or in a
        NumPy array.

    Returns
    -------
    (m,4,4) array of float64
        In the file's order, without times.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.io import read_transforms
    >>> _ = Path("drive.txt").write_text("1.0 0 0 0 0 0 0 1\n1.1 0.5 0 0 0 0 0 1\n")
    >>> read_transforms("drive.txt")[:, :3, 3]
    array([[0. , 0. , 0. ],
           [0.5, 0. , 0. ]])
    """
    path = as_path("path", path)
    if path.suffix.lower() in _CLOUDS and read_content(path):
        raise InputError(f"{path}: is a cloud, not a pose; {_NOTATIONS}")
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
    """Read lists of numbers, or the only lists of an object."""
    value = load_json(content)
    if isinstance(value, dict):
        lists = [entry for entry in value.values() if isinstance(entry, list)]
        if len(lists) != 1:
            raise InputError(
                f"{len(lists)} of its entries are lists; one is to be, that of the pose's numbers"
            )
        value = lists[0]
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError("its lists are of unequal lengths") from error
    if array.dtype.kind not in "iuf":
        raise InputError("its lists hold something else than numbers")
    return array


def write_transform(path: str | os.PathLike[str], transform: ArrayLike) -> None:
    """Write a 4x4 rigid transform, exact to the last bit.

    Parameters
    ----------
    path : path-like
        ``.npy``, or text of any other suffix.
    transform : (4,4) or (3,4) array_like of float
        Rotation and translation.
    """
    path = as_path("path", path)
    matrix = check_rigid(transform)
    write_array(path, matrix, number_lines(matrix))


def find_poses(name: str, numbers: NDArray[Any]) -> FloatArray:
    """Return poses (m,4,4) from numbers in any notation, by their shape; errors count poses from 1."""
    values = as_floats(name, numbers)
    table = values.reshape(1, -1) if values.ndim < 2 or values.shape[1:] == (1,) else values
    rows, columns = table.shape[-2:]
    if table.ndim == 2 and rows and columns in (7, 8):
        poses = from_quaternions(name, table[:, -7:])
    elif table.ndim == 2 and rows and columns in (12, 16):
        poses = _with_last_row(table.reshape(rows, -1, 4))
        turned = _with_last_row(table.reshape(rows, 4, -1).transpose(0, 2, 1))
        if not are_rigid(poses).all() and are_rigid(turned).all():
            remedy = f"its {columns} numbers are a pose column by column; transpose it: write row by row"
            raise InputError(name, remedy=remedy)
    elif (
        table.size and columns == 4 and (rows in (3, 4) if table.ndim == 3 else _are_below_each_other(table))
    ):
        poses = _with_last_row(table.reshape(-1, min(rows, 4), 4))
    else:
        raise _refusal(name, values)
    for row in np.flatnonzero(~are_rigid(poses)):
        check_rigid(poses[row], _pose_name(name, int(row), len(poses)))
    return poses


def _are_below_each_other(table: FloatArray) -> bool:
    return table.ndim == 2 and (len(table) == 3 or len(table) % 4 == 0)


def _with_last_row(poses: FloatArray) -> FloatArray:
    last = np.broadcast_to([[0.0, 0.0, 0.0, 1.0]], (len(poses), 4 - poses.shape[1], 4))
    return np.concatenate([poses, last], axis=1)


def from_quaternions(name: str, rows: FloatArray) -> FloatArray:
    """Return the poses (m,4,4) of rows tx ty tz qx qy qz qw."""
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(rows[:, 3:], axis=1)
        firsts = np.linalg.norm(rows[:, :4], axis=1)
    wrong = np.flatnonzero(~(np.abs(lengths - 1) <= RIGID_TOLERANCE))
    if len(wrong):
        first = abs(firsts[wrong[0]] - 1) <= RIGID_TOLERANCE
        hint = "; the first four numbers are one: write tx ty tz qx qy qz qw" if first else ""
        where = _pose_name(name, int(wrong[0]), len(rows))
        raise InputError(f"{where}: its quaternion is of length {lengths[wrong[0]]:.6g}, not 1{hint}")
    x, y, z, w = (rows[:, 3:] / lengths[:, None]).T
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = turn(x, y, z, w), rows[:, :3]
    return poses


def _pose_name(name: str, row: int, count: int) -> str:
    return name if count == 1 else f"{name}: pose {row + 1} of {count}"


def _refusal(name: str, values: FloatArray) -> InputError:
    if values.shape == (4, 3):
        return InputError(f"{name}: got 4 rows of 3 numbers; transpose them: 3 rows of 4, the last column t")
    if values.ndim == 2:
        got = f"{len(values)} row{'s' if len(values) != 1 else ''} of {values.shape[1]} numbers"
    else:
        got = f"an array of shape {values.shape}"
    return InputError(f"{name}: got {got}; {_NOTATIONS}")


def read_log(path: Path) -> dict[tuple[int, int], FloatArray]:
    """Read a ``gt.log`` of 3DMatch, 3DLoMatch or FGR: ``T_i_j`` by (i, j), in the file's order.

    It has five lines per pair: ``i j n``, and a 4x4 transform that maps cloud j into the frame of cloud i.
    """
    return read_matrices(path, 4, check_rigid)


def read_matrices(
    path: Path, size: int, check: Callable[[FloatArray, str], FloatArray] = lambda matrix, _: matrix
) -> dict[tuple[int, int], FloatArray]:
    """Read a list of square matrices, each after a line ``i j n``, by (i, j)."""
    found: dict[tuple[int, int], FloatArray] = {}
    lines = [line.split() for line in load_text(path).splitlines() if line.strip()]
    try:
        for start in range(0, len(lines), size + 1):
            first, second = (int(word) for word in lines[start][:2])
            rows = [[float(word) for word in line] for line in lines[start + 1 : start + size + 1]]
            matrix = np.array(rows).reshape(size, size)
            found[first, second] = check(matrix, f"pose {first} {second}")
    except (ValueError, OverflowError) as error:
        form = f"{size + 1} lines each: `i j n`, then a {size}x{size} matrix"
        raise InputError(f"{path}: not a list of poses; {form} ({error})") from error
    if len(found) * (size + 1) < len(lines):
        raise InputError(f"{path}: lists a pair twice; give each pair once")
    return found


def format_log(pairs: IndexArray, poses: FloatArray) -> str:
    """Write poses of pairs (n,2), exact to the last bit; some readers split lines at tabs only."""
    count = int(pairs.max(initial=-1)) + 1
    blocks = zip(pairs.tolist(), map(number_lines, poses), strict=True)
    lines = [line for (i, j), rows in blocks for line in (f"{i} {j} {count}", *rows)]
    return "".join(f"{line}\n" for line in lines).replace(" ", "\t")
