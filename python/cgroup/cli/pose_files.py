"""Poses in files that several pairs of clouds share a folder for: named after the pair, and kept apart."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from cgroup import io
from cgroup._checks.quoting import escape
from cgroup.errors import InputError
from cgroup.io._files import number_lines
from cgroup.types import FloatArray

_LONGEST = 100
"""Bytes of either cloud's name in that of a file; file systems take some 255 in all."""


def name_of_pair(source: Path, target: Path, how: str = "on") -> str:
    """Return what the names of all files begin with that are written of a pair."""
    names = (os.fsencode(file.stem)[:_LONGEST].decode(errors="ignore") for file in (source, target))
    return f"_{how}_".join(names)


def name_frames(source: Path, target: Path) -> str:
    """Return the line by which the file of a pose tells its pair."""
    places = (escape(os.path.abspath(file)) for file in (source, target))  # noqa: PTH100 - links stay
    return "# pose of {} in the frame of {}".format(*places)


def write_pose(file: Path, pose: FloatArray, frames: str) -> None:
    """Write a pose, exact to the last bit, and below it the line that tells its pair."""
    io.write_file(file, "\n".join([*number_lines(pose), frames, ""]).encode())


def refuse_others(files: Iterable[Path], frames: str) -> None:
    """Raise `InputError` where a file would be replaced that isn't the pose of this pair."""
    for file in files:
        if file.is_file() and frames not in file.read_text(encoding="utf-8", errors="replace").splitlines():
            message = f"{file}: is there, and not of these clouds; rename it, or give another folder by --out"
            raise InputError(message)
