"""Files of rigid transforms."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup._values import as_path
from cgroup.io._files import load_numbers, parse_file, write_file
from cgroup.io._numpy_files import load_npy, npy_bytes
from cgroup.rigid import check_rigid

if TYPE_CHECKING:
    import os

    from numpy.typing import ArrayLike

    from cgroup.types import FloatArray


def read_transform(path: str | os.PathLike[str]) -> FloatArray:
    r"""Read a 4x4 rigid transform of column vectors.

    Parameters
    ----------
    path : path-like
        ``.npy``, or text of any suffix (``.txt``, ``.xf``): four rows of four numbers.

    Returns
    -------
    (4,4) array of float64
        The transform.

    Raises
    ------
    InputError
        If the file is missing or unreadable, or isn't a rigid transform.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.io import read_transform
    >>> _ = Path("pose.txt").write_text("1 0 0 5\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")
    >>> read_transform("pose.txt")[:3, 3]
    array([5., 0., 0.])
    """
    path = as_path("path", path)
    reader = load_npy if path.suffix.lower() == ".npy" else load_numbers
    return check_rigid(parse_file(path, reader), str(path))


def write_transform(path: str | os.PathLike[str], transform: ArrayLike) -> None:
    """Write a 4x4 rigid transform, exact to the last bit.

    Parameters
    ----------
    path : path-like
        ``.npy``, or text of any other suffix.
    transform : (4,4) array_like of float
        Rotation and translation.

    Raises
    ------
    InputError
        If it isn't rigid, or the file can't be written.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.io import read_transform, write_transform
    >>> write_transform("pose.npy", np.eye(4))
    >>> bool((read_transform("pose.npy") == np.eye(4)).all())
    True
    """
    path = as_path("path", path)
    matrix = check_rigid(transform)
    if path.suffix.lower() == ".npy":
        write_file(path, npy_bytes(matrix))
    else:
        rows = (" ".join(repr(float(number)) for number in row) for row in matrix)
        write_file(path, ("\n".join(rows) + "\n").encode())
