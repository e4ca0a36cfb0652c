"""What files of clouds have of each point that is neither used nor kept."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from cgroup.io._e57 import unread_fields
from cgroup.io._files import printable

if TYPE_CHECKING:
    import os

_HEAD = 1 << 16  # bytes of a file that its header takes at most
_MOST_NAMED = 12
_KEPT = {
    *("x", "y", "z", "nx", "ny", "nz", "normal_x", "normal_y", "normal_z", "curvature", "_"),
    *("red", "green", "blue", "alpha", "r", "g", "b", "a", "rgb", "rgba"),
    *("diffuse_red", "diffuse_green", "diffuse_blue", "vp_x", "vp_y", "vp_z"),
}
_LAS = ("intensity", "returns", "classification", "scan angle", "user data", "point source")
_WITHOUT_TIME, _WITH_NEAR_INFRARED, _WITH_WAVES = {0, 2}, {8, 10}, {4, 5, 9, 10}
"""Point formats of LAS."""


_TEXTS = {".xyz": 3, ".asc": 3, ".txt": 3, ".csv": 3, ".xyzn": 6, ".xyzrgb": 6, ".pts": 3}
"""Columns that are read where a line of names is missing."""


def unkept_attributes(path: str | os.PathLike[str]) -> list[str]:
    """Return the names of what is neither used nor kept, as far as the header of the file has them."""
    suffix = Path(path).suffix.lower()
    try:
        with Path(path).open("rb") as file:
            head = file.read(_HEAD)
    except OSError:  # it is gone since it was read
        return []
    if suffix in (".las", ".laz"):
        kind = head[104] & 0x3F if len(head) > 104 else 0
        more = [("GPS time", kind not in _WITHOUT_TIME), ("near infrared", kind in _WITH_NEAR_INFRARED)]
        more += [("waveforms", kind in _WITH_WAVES)]
        return [*_LAS, *(name for name, is_there in more if is_there)]
    fixed = {".bin": ["reflectance"], ".ptx": ["intensity"]}.get(suffix)
    if fixed is not None:
        return fixed
    text = head.decode("latin-1")
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
    elif suffix == ".e57":
        names = unread_fields(Path(path))
    elif suffix in _TEXTS:
        names = _columns_of(text, suffix)
    return [printable(name) for name in names if name.lower() not in _KEPT][:_MOST_NAMED]


def _columns_of(text: str, suffix: str) -> list[str]:
    """Return the names of the columns of a text; numbers of those that have no name and are not read."""
    rows = [re.split(r"[\s,;]+", line.strip().lstrip("#/").strip()) for line in text.splitlines()]
    rows = [row for row in rows if len(row) >= 3]
    if rows and {"x", "y", "z"} <= {name.lower() for name in rows[0]}:
        return rows[0]
    count = len(rows[-2 if len(rows) > 1 else -1]) if rows else 0  # the last row may be cut
    if suffix == ".pts":  # x y z, intensity, r g b
        return ["intensity"] if count in (4, 7) else []
    return [f"column {number}" for number in range(_TEXTS[suffix] + 1, count + 1)]
