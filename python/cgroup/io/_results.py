"""Result folders: checked before work starts, made at the first output."""

from __future__ import annotations

from contextlib import contextmanager
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable
    from pathlib import Path

_NO_FOLDER = "can't be made a folder for the results"


def check_folder(path: Path) -> Path:
    """See that a folder for results can be made and written to, without making it."""
    with _refusing(path, _NO_FOLDER):
        there = next(folder for folder in (path, *path.absolute().parents) if folder.exists())
        TemporaryFile(dir=there).close()
    return path


def make_folder(path: Path) -> Path:
    """Make a folder for results, unless it is there."""
    with _refusing(path, _NO_FOLDER):
        path.mkdir(parents=True, exist_ok=True)
    return path


def remove_files(paths: Iterable[Path]) -> None:
    """Remove what an earlier run has left, so that it isn't taken for what this one found."""
    for path in paths:
        with _refusing(path, "can't be removed"):
            path.unlink(missing_ok=True)


@contextmanager
def _refusing(path: Path, what: str) -> Generator[None]:
    try:
        yield
    except (OSError, ValueError) as error:
        message = f"{path}: {what} ({getattr(error, 'strerror', None) or error})"
        raise InputError(message) from error
