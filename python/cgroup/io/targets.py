"""Read surveyed targets: names and coordinates."""

from __future__ import annotations

import os
import re

import numpy as np

from cgroup._checks.quoting import escape
from cgroup._checks.values import as_path
from cgroup.errors import InputError
from cgroup.io.files import load_numbers, parse_file
from cgroup.types import FloatArray

_NUMBER = r"\s*[-+]?\.?\d[^,\s]*\s*"
_COMMAS = re.compile(r"[^,]*(,\s*[^,\s]+\s*){3}(,.*)?")  # a name and three words, separated by commas
_SPLIT = re.compile(r"[^,]*(,\s*[-+]?\d+\s*){6}")  # as decimal commas make of three numbers
_WORD = re.compile(r"(?!nan\b|inf)[^\W\d]", re.IGNORECASE)


def read_targets(path: str | os.PathLike[str]) -> dict[str, FloatArray]:
    r"""Read surveyed targets, such as those of a total station or a scanner.

    Parameters
    ----------
    path : path-like
        Text, such as CSV: name, x, y and z per line, separated by semicolons, tabs, commas or white space;
        further columns are ignored. A first line of column names is skipped; # and // start comments. Commas
        between digits are decimal ones unless they separate the columns.

    Returns
    -------
    dict of str to (3,) array of float64
        Coordinates by name, in the file's order.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.io import read_targets
    >>> _ = Path("targets.csv").write_text(
    ...     "name;x;y;z\nT1;1,5;2,0;0,25\nT2;8,0;1,0;0,5\n"
    ... )
    >>> read_targets("targets.csv")["T1"]
    array([1.5 , 2.  , 0.25])
    """
    return parse_file(as_path("path", path), _parse)


def _parse(content: bytes) -> dict[str, FloatArray]:
    lines = content.decode("utf-8-sig", errors="replace").splitlines()
    rows = [_split(line, at) for at, line in enumerate(lines, 1)]
    first = next((at for at, row in enumerate(rows) if row), 0)
    if rows and rows[first] and all(_WORD.match(word) for word in rows[first][1:4]):
        rows[first] = []
    # One text, whose lines are those of the file, so that all numbers are written alike
    points = load_numbers("\n".join(";".join(row[1:4]) for row in rows).encode())
    if points.shape[1] != len("xyz"):
        raise InputError("its coordinates have blanks; write numbers without groups of digits")
    numbered = [(at, row[0]) for at, row in enumerate(rows, 1) if row]
    found: dict[str, FloatArray] = {}
    for (at, name), point in zip(numbered, points, strict=True):
        if name in found or not np.isfinite(point).all():
            reason = "is listed twice" if name in found else "has a coordinate that isn't finite"
            raise InputError(f"line {at}: the target {escape(name)} {reason}")
        found[name] = point
    return found


def _split(line: str, at: int) -> list[str]:
    """Return the cells of a line; none for a comment or an empty line."""
    line = re.split(r"(?:^|\s)(?:#|//)", line)[0].strip()
    separator = next((mark for mark in ";\t" if mark in line), "," if _COMMAS.fullmatch(line) else None)
    cells = [cell.strip().strip("\"'") for cell in line.split(separator)]
    if _SPLIT.fullmatch(line):
        raise InputError(f"line {at}: its commas may be decimal ones; separate the columns by semicolons")
    if line and (len(cells) < 4 or not all(cells[:4])):
        raise InputError(f"line {at}: a target is a name, x, y and z")
    if separator is None and re.fullmatch(_NUMBER, "".join(cells[4:5])):
        raise InputError(f"line {at}: five columns; separate them by semicolons if names contain spaces")
    return cells if line else []
