"""Result folders: checked before work starts, made at the first output."""

from __future__ import annotations

from tempfile import TemporaryFile
from typing import TYPE_CHECKING

from cgroup.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path


def check_folder(path: Path) -> Path:
    """See that a folder for results can be made and written to, without making it."""
    try:
        there = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
        TemporaryFile(dir=there).close()
    except (OSError, ValueError) as error:
        raise _no_folder(path, error) from error
    return path


def make_folder(path: Path) -> Path:
    """Make a folder for results, unless it is there."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise _no_folder(path, error) from error
    return path


def check_file(path: Path) -> None:
    """See that a file can be written, without a change to one that is there."""
    try:
        if path.exists():
            path.open("ab").close()
        else:
            TemporaryFile(dir=path.parent).close()
    except (OSError, ValueError) as error:
        message = f"{path}: can't be written ({_reason(error)})"
        raise InputError(message) from error


def _no_folder(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: can't be made a folder for the results ({_reason(error)})")


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
