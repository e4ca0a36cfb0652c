"""Attributes of points in files of clouds that are neither used nor kept."""

import os
import re
from pathlib import Path

from cgroup._checks.quoting import escape
from cgroup.io._e57 import unread_fields

_HEAD = 1 << 16  # bytes of a file that its header takes at most
_MOST_NAMED = 12
_KEPT = {
    *("x", "y", "z", "nx", "ny", "nz", "normal_x", "normal_y", "normal_z", "curvature", "_"),
    *("red", "green", "blue", "alpha", "r", "g", "b", "a", "rgb", "rgba"),
    *("diffuse_red", "diffuse_green", "diffuse_blue", "vp_x", "vp_y", "vp_z"),
}
_LAS = ("intensity", "returns", "classification", "scan angle", "user data", "point source")
_WITHOUT_TIME, _WITH_NEAR_INFRARED, _WITH_WAVES = {0, 2}, {8, 10}, {4, 5, 9, 10}  # point formats of LAS


# Columns that are read if no line has names; those of PTS depend on their number
TEXTS = {".xyz": 3, ".asc": 3, ".txt": 3, ".csv": 3, ".xyzn": 6, ".xyzrgb": 6, ".pts": 3}

_COMMENTS, _LEAST_COLUMNS = ("#", "//"), 3
_FIXED = {
    ".bin": ["reflectance"],
    ".ptx": ["intensity"],
    "points3D.bin": ["reprojection error", "track"],
    "points3D.txt": ["reprojection error", "track"],
}


def unkept_attributes(path: str | os.PathLike[str]) -> list[str]:
    """Return the names of attributes that are neither used nor kept, from the header of the file."""
    suffix = Path(path).suffix.lower()
    try:
        with Path(path).open("rb") as file:
            head = file.read(_HEAD)
            fields = unread_fields(file) if suffix == ".e57" else []
    except OSError:  # it is gone since it was read
        return []
    if suffix in (".las", ".laz"):
        kind = head[104] & 0x3F if len(head) > 104 else 0
        more = [("GPS time", kind not in _WITHOUT_TIME), ("near infrared", kind in _WITH_NEAR_INFRARED)]
        more += [("waveforms", kind in _WITH_WAVES)]
        return [*_LAS, *(name for name, is_there in more if is_there)]
    fixed = _FIXED.get(Path(path).name, _FIXED.get(suffix))
    if fixed is not None:
        return fixed
    text = head.decode("latin-1")
    if suffix in TEXTS:
        fields = _unread_columns(text, suffix)
    if fields:
        return [escape(name) for name in fields][:_MOST_NAMED]
    lines = [line.split() for line in text.splitlines()]
    names: list[str] = []
    if suffix == ".pcd":
        names = next((line[1:] for line in lines if line[:1] in (["FIELDS"], ["COLUMNS"])), [])
    elif suffix == ".ply":
        element = ""
        for line in lines:
            if line == ["end_header"]:
                break
            element = line[1] if line[:1] == ["element"] and len(line) > 1 else element
            names += [line[-1]] if line[:1] == ["property"] and element == "vertex" else []
    return [escape(name) for name in names if name.lower() not in _KEPT][:_MOST_NAMED]


def _unread_columns(text: str, suffix: str) -> list[str]:
    """Return the unread columns of a text: their names if a line has names, else their numbers."""
    rows = [row.strip() for row in text.splitlines()]
    comments = [row.lstrip("#/") for row in rows if row.startswith(_COMMENTS)]
    points = [
        row for row in rows if not row.startswith(_COMMENTS) and len(_numbers_of(row)) >= _LEAST_COLUMNS
    ]
    first = points[0] if points else ""
    if _has_axes(_names_of(first)):
        return [name for name in _names_of(first) if name.lower() not in _KEPT]
    count = len(_numbers_of(first))
    if suffix == ".pts":  # x y z, intensity, r g b
        return ["intensity"] if count in (4, 7) else []
    named = [_names_of(row) for row in comments]
    names = next((row for row in named if len(row) == count and _has_axes(row)), None)
    return (names or [f"column {number}" for number in range(1, count + 1)])[TEXTS[suffix] :]


def _has_axes(names: list[str]) -> bool:
    return {"x", "y", "z"} <= {name.lower() for name in names}


def _names_of(row: str) -> list[str]:
    separator = next((each for each in ",;\t" if each in row), None)
    return [name.strip().strip('"') for name in row.split(separator)]


def _numbers_of(row: str) -> list[str]:
    """Return the fields of a line; commas are decimal if white space or semicolons separate the fields."""
    is_decimal = re.search(r"[\s;]", row) and not re.search(r",\s", row)
    return re.findall(r"[^\s;]+" if is_decimal else r"[^\s,;]+", row)
