"""Files that are written whole or not at all: a part beside the file takes its place once it is complete."""

from __future__ import annotations

import errno
import os
import secrets
import stat
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

_IS_WINDOWS = sys.platform == "win32"
"""Windows neither moves nor removes a file that is open, and has no `flock`."""

_BEGIN, _END = ".cgroup-", ".part"
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


def remove_dead_parts(folder: Path) -> None:
    """Remove the parts that processes left when they were killed: regular files without a lock."""
    for part in folder.glob(f"{_BEGIN}*{_END}"):
        with suppress(OSError):  # it is locked, gone, or no file
            number = os.open(part, _FLAGS)
            try:
                if not stat.S_ISREG(os.fstat(number).st_mode):
                    continue
                _lock(number)
                if not _IS_WINDOWS:
                    part.unlink()
            finally:
                os.close(number)
            if _IS_WINDOWS:
                part.unlink()


def _lock(number: int) -> None:
    """Lock an open file until it is closed; raise `OSError` where it is locked already."""
    if sys.platform != "win32":
        import fcntl  # noqa: PLC0415 - of Unix

        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
