"""Read and write correspondences and groups."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_mask
from cgroup._checks.values import as_instance, as_path
from cgroup.errors import InputError
from cgroup.io.clouds import PARSERS
from cgroup.io.files import load_numbers, naming, parse_file, read_content, write_file, written_path
from cgroup.io.numpy_files import load_npy, npz_bytes, read_arrays, single_number, write_array
from cgroup.types import OPTIONAL_FIELDS, Correspondences, FloatArray

# How a line of a table's names begins, perhaps behind the mark of UTF-8
_NAME = re.compile(rb"(\xef\xbb\xbf)?\s*[\"']?(?!nan\b|inf)[A-Za-z_]", re.IGNORECASE)
# Suffixes of clouds whose files may hold matches as well
_TABLES = {".asc", ".csv", ".npy", ".npz", ".pts", ".txt", ".xyz"}


def read_correspondences(path: str | os.PathLike[str]) -> Correspondences:
    r"""Read correspondences, computed elsewhere or by `write_correspondences`.

    Parameters
    ----------
    path : path-like
        ``.npz`` with arrays named as the fields of `Correspondences` (``source`` and ``target`` are needed);
        or six columns, x y z of the source and of the target: ``.npy``, or text of any other suffix; the
        first line of a ``.csv`` may name them.

    Returns
    -------
    Correspondences
        One row per match, in the file's order.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.io import read_correspondences
    >>> _ = Path("matches.txt").write_text("0 0 0 5 0 0\n1 0 0 6 0 0\n")
    >>> read_correspondences("matches.txt")
    Correspondences(n=2, fields=['source', 'target'])
    """
    path = as_path("path", path)
    suffix = path.suffix.lower()
    if suffix in PARSERS.keys() - _TABLES and read_content(path):
        raise InputError(f"{path}: is a cloud, not matches; use `register` to place one cloud on another")
    if suffix == ".npz":
        arrays = read_arrays(path, ("source", "target"), OPTIONAL_FIELDS)
    else:
        arrays = _read_table(path)
    optional: dict[str, Any] = {name: arrays[name] for name in OPTIONAL_FIELDS if name in arrays}
    if "resolution" in optional:
        optional["resolution"] = single_number(path, optional["resolution"])
    with naming(path):
        return Correspondences(arrays["source"], arrays["target"], **optional)


def _read_table(path: Path) -> dict[str, Any]:
    """Read six columns: coordinates of the source, then of the target."""
    loaders = {".npy": load_npy, ".csv": _load_csv}
    table = parse_file(path, loaders.get(path.suffix.lower(), load_numbers))
    if table.ndim != 2 or table.shape[1] != 6:
        got = f"{table.shape[1]} columns" if table.ndim == 2 else f"an array of shape {table.shape}"
        message = f"{path}: has {got}; correspondences have six: x y z of the source, x y z of the target"
        if table.shape[1:] == (3,):
            message += "; use `register` to place one cloud on another"
        raise InputError(message)
    return {"source": table[:, :3], "target": table[:, 3:]}


def _load_csv(content: bytes) -> FloatArray:
    """Read rows of numbers; a first line that begins with a name is skipped."""
    first, _, rest = content.partition(b"\n")
    return load_numbers(rest if rest and _NAME.match(first) else content)


def write_correspondences(path: str | os.PathLike[str], correspondences: Correspondences) -> None:
    """Write correspondences with all their fields.

    Parameters
    ----------
    path : path-like
        Must end in ``.npz``.
    correspondences : Correspondences
        Correspondences with their fields.
    """
    path = written_path(path, "correspondences", ".npz")
    as_instance("correspondences", correspondences, Correspondences)
    values = {name: getattr(correspondences, name) for name in ("source", "target", *OPTIONAL_FIELDS)}
    write_file(path, npz_bytes(**{name: value for name, value in values.items() if value is not None}))


def write_mask(path: str | os.PathLike[str], mask: ArrayLike) -> None:
    """Write the mask of the correspondences in a group.

    Parameters
    ----------
    path : path-like
        ``.npy`` (bool), or text of any other suffix: one 0 or 1 per line.
    mask : (n,) array_like of bool
        Aligned with the correspondences.
    """
    path = as_path("path", path)
    values = as_mask("mask", mask)
    write_array(path, values, (str(int(value)) for value in values))
