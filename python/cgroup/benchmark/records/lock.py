"""One run at a time in a folder."""

from __future__ import annotations

import sqlite3
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING

from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Generator
    from pathlib import Path


@contextmanager
def only_writer(folder: Path) -> Generator[None, None, None]:
    """Keep other runs off a folder; the lock goes with the process, however it ends.

    Raises
    ------
    InputError
        If another run works in the folder, or it can't be written to.
    """
    with closing(_take(folder)):
        yield


def _take(folder: Path) -> sqlite3.Connection:
    try:
        lock = sqlite3.connect(folder / "lock.sqlite", isolation_level=None, timeout=0)
        try:
            lock.execute("begin exclusive")
        except BaseException:
            lock.close()
            raise
    except sqlite3.Error as error:
        if "locked" in str(error):
            message = f"{folder}: another run is at work there ({error}); wait for it or use another folder"
        else:
            message = f"{folder}: can't be written to ({error}); make room there, or use another folder"
        raise InputError(message) from error
    return lock
