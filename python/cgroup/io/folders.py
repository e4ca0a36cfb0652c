"""Files of clouds, of which a folder or a pattern stands for several."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable
from pathlib import Path

from cgroup._checks.quoting import escape
from cgroup._checks.values import as_path
from cgroup.errors import InputError
from cgroup.io.clouds import PARSERS

_OTHERS_TOO = {".csv", ".npy", ".npz", ".txt"}
"""Suffixes of clouds that poses, matches and notes have as well: a folder's are not taken."""


def find_clouds(name: str, paths: Iterable[str | os.PathLike[str]]) -> list[Path]:
    """Return the files that paths stand for: the clouds of a folder, and what a pattern matches, by name."""
    return [file for path in paths for file in _files_of(name, as_path(name, path))]


def _files_of(name: str, path: Path) -> list[Path]:
    text = str(path)
    if os.path.isdir(path):  # noqa: PTH112 - a path that the system refuses is no folder
        suffixes = PARSERS.keys() - _OTHERS_TOO
        files = [file for file in _listed(path) if file.suffix.lower() in suffixes]
        got = "a folder without clouds"
        remedy = (
            f"files whose names end in {' '.join(sorted(suffixes))} are taken; name others by a pattern, "
            f"as {escape(text)}/*.txt"
        )
    elif glob.has_magic(text) and not os.path.lexists(path):
        files = [file for file in map(Path, glob.glob(text, recursive=True)) if file.is_file()]  # noqa: PTH207 - absolute ones
        got, remedy = "a pattern that no file matches", "check the folder and the suffix"
    else:
        return [path]
    if not files:
        raise InputError(f"{name}: {escape(text)}", got, remedy)
    return sorted(files)


def _listed(folder: Path) -> list[Path]:
    try:
        return [file for file in folder.iterdir() if file.is_file() and not file.name.startswith(".")]
    except OSError as error:
        raise InputError(f"{folder}: can't be read ({error.strerror or error})") from error
