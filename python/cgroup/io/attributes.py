"""Attributes of points in files of clouds that are neither used nor kept."""

import os
from pathlib import Path

from cgroup import _core
from cgroup._checks.quoting import escape
from cgroup.io._e57 import unread_fields

_HEAD, _MOST_NAMED = 1 << 16, 12  # most bytes of a header; most names that are returned
_KEPT = {
    *("x", "y", "z", "nx", "ny", "nz", "normal_x", "normal_y", "normal_z", "curvature", "_"),
    *("red", "green", "blue", "alpha", "r", "g", "b", "a", "rgb", "rgba"),
    *("diffuse_red", "diffuse_green", "diffuse_blue", "vp_x", "vp_y", "vp_z"),
    *("intensity", "scalar_intensity"),
}
_LAS = ("returns", "classification", "scan angle", "user data", "point source")
_WITHOUT_TIME, _WITH_NEAR_INFRARED, _WITH_WAVES = {0, 2}, {8, 10}, {4, 5, 9, 10}  # point formats of LAS

# Columns that are read if no line has names; of PTS all are
TEXTS = {".xyz": 3, ".asc": 3, ".txt": 3, ".csv": 3, ".xyzn": 6, ".xyzrgb": 6, ".pts": 7}

_FIXED = {
    **dict.fromkeys((".bin", ".ptx", ".pts"), ()),
    **dict.fromkeys(("points3D.bin", "points3D.txt"), ("reprojection error", "track")),
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
        return [*fixed]
    text = head.decode("latin-1")
    if suffix in TEXTS:
        fields = _unread_columns(head, suffix)
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


def _unread_columns(head: bytes, suffix: str) -> list[str]:
    """Return the unread columns of a text: their names if a line has names, else their numbers."""
    names, count = list[str](), 0
    for line in head.splitlines():
        _, words, is_comment = _core.columns_of(line)
        has_axes = {"x", "y", "z"} <= {word.lower() for word in words}
        if has_axes and not is_comment:
            return [name for name in words if name.lower() not in _KEPT]
        if has_axes:
            names = words
        elif words and not is_comment:
            count = len(words)
            break
    numbered = [f"column {number}" for number in range(1, count + 1)]
    return (names if len(names) == count else numbered)[TEXTS[suffix] :]
