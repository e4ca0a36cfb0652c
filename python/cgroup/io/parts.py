"""Files that are written whole or not at all: a part beside the file takes its place once it is complete."""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import stat
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from pathlib import Path

_IS_WINDOWS = sys.platform == "win32"
"""Windows neither moves nor removes a file that is open, and has no `flock`."""

_BEGIN, _END, _ALIVE = ".cgroup-", ".part", "locked"
_FLAGS = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0)


def replace_whole(path: Path, content: bytes, ready: Callable[[], object]) -> None:
    """Write a part, call `ready`, and put the part in the place of the file.

    The part is locked as long as its process lives. A process that is killed leaves it without a lock, for
    `remove_dead_parts`.
    """
    status = path.stat() if path.exists() else None
    if status is not None and not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))
    part = path.parent / f"{_BEGIN}{secrets.token_hex(4)}{_END}"
    try:
        with part.open("xb") as file:
            with suppress(OSError):  # of a file system without locks
                _lock(file.fileno())
            if status is not None:
                part.chmod(stat.S_IMODE(status.st_mode))
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
            ready()
            if not _IS_WINDOWS:
                part.replace(path)  # while it is locked
        if _IS_WINDOWS:
            part.replace(path)
    except BaseException:
        with suppress(OSError):
            part.unlink()
        raise


@contextmanager
def folder_made_whole(folder: Path) -> Generator[Path]:
    """Return an empty folder that takes the place of a new one where the block ends without an error.

    Its part holds a locked file as long as its process lives, for `remove_dead_parts`.
    """
    remove_dead_parts(folder.parent)
    part = folder.parent / f"{_BEGIN}{secrets.token_hex(4)}{_END}"
    part.mkdir()
    try:
        with (part / _ALIVE).open("xb") as file:
            with suppress(OSError):  # of a file system without locks
                _lock(file.fileno())
            (part / folder.name).mkdir()
            yield part / folder.name
            (part / folder.name).rename(folder)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def remove_dead_parts(folder: Path) -> None:
    """Remove the parts that processes left when they were killed: files and folders without a lock."""
    for part in folder.glob(f"{_BEGIN}*{_END}"):
        with suppress(OSError):  # it is locked, gone, or no part
            if part.is_dir() and not part.is_symlink():
                _refuse_alive(part / _ALIVE)
                shutil.rmtree(part)
            else:
                _refuse_alive(part)
                part.unlink()


def _refuse_alive(path: Path) -> None:
    """Raise `OSError` where a path is no regular file, or one that a process has locked."""
    number = os.open(path, _FLAGS)
    try:
        if not stat.S_ISREG(os.fstat(number).st_mode):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        _lock(number)
    finally:
        os.close(number)


def _lock(number: int) -> None:
    """Lock an open file until it is closed; raise `OSError` where it is locked already."""
    if sys.platform != "win32":
        import fcntl  # noqa: PLC0415 - of Unix

        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
