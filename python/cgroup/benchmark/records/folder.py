"""The folder of a run."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path


def make_folder(path: Path) -> None:
    """Make a folder, unless it is there; raise `InputError` with the system's reason where it can't be."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        message = f"{path}: can't be made a folder ({error.strerror or error}); use another one with --out"
        raise InputError(message) from error
