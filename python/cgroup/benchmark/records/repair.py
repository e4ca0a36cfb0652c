"""Damaged records set aside: what is whole goes on in a new file, the old one stays beside it."""

from __future__ import annotations

import itertools
import os
import sqlite3
from contextlib import closing, suppress
from typing import TYPE_CHECKING

from cgroup.benchmark.records.checksums import decode_text, is_whole
from cgroup.benchmark.records.integrity import Health, examine
from cgroup.benchmark.records.layout import (
    SCHEMA_VERSION,
    TABLES,
    WITH_CHECKSUMS,
    list_columns,
    prepare_layout,
    read_version,
)
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_HALVES = (
    "delete from correspondences where error = '' and case_key not in (select case_key from arrays)",
    "delete from arrays where case_key not in (select case_key from correspondences)",
)


def set_damaged_aside(path: Path) -> str:
    """Examine a file of records; where something is amiss, go on without it.

    Parameters
    ----------
    path : path
        The SQLite file; nothing else may be writing to it.

    Returns
    -------
    str
        What was damaged, and where the old file is now; "" where all is well.

    Raises
    ------
    InputError
        If the system doesn't let the files be moved.
    """
    new = _name_new(path)
    if new.exists() and not path.exists():  # stopped in between
        new.rename(path)
    if not path.exists() or not path.stat().st_size:
        return ""
    with closing(sqlite3.connect(path, timeout=30)) as connection:
        try:
            if not WITH_CHECKSUMS <= read_version(connection) <= SCHEMA_VERSION:
                return ""
            health = examine(connection)
        except sqlite3.DatabaseError as error:
            if "malformed" not in str(error):
                raise
            health = Health({}, [], [str(error)])
    if health.sound:
        return ""
    try:
        kept = _replace(path)
    except OSError as error:
        message = (
            f"{path}: damaged, and can't be set aside ({error.strerror or error}); once that is mended, "
            "run the same command again to continue"
        )
        raise InputError(message) from error
    what = [each.name for each in health.damaged] + health.faults
    return f"{len(what)} damaged: {'; '.join(what)}; all as it was is in {kept}"


def _replace(path: Path) -> Path:
    """Put a file with all that is whole in place of a damaged one, and return the new path of that."""
    kept = _find_free_name(path)
    new = _name_new(path)
    _remove(new)
    _copy_whole(path, new)
    for suffix in ("-wal", "-shm"):  # it would be taken for that of the new file
        with suppress(FileNotFoundError):
            path.with_name(path.name + suffix).rename(kept.with_name(kept.name + suffix))
    path.rename(kept)
    new.rename(path)
    return kept


def _copy_whole(path: Path, new: Path) -> None:
    """Copy the rows that are what was written; what only half of is left has to be computed anew."""
    with closing(sqlite3.connect(path)) as old, closing(sqlite3.connect(new, isolation_level=None)) as made:
        old.text_factory = decode_text
        made.execute("begin")
        prepare_layout(made, new)
        for table in TABLES:
            columns, _ = list_columns(made, table)
            marks = ", ".join("?" * len(columns))
            for row in _read_whole(old, table):
                made.execute(f"insert or ignore into {table} values ({marks})", row)
        for statement in _HALVES:
            made.execute(statement)
        made.execute("commit")
    descriptor = os.open(new, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _read_whole(connection: sqlite3.Connection, table: str) -> Iterator[tuple[object, ...]]:
    """Read from both ends, up to a page that can't be read."""
    try:
        _, key = list_columns(connection, table)
        rowid = connection.execute("select sql from sqlite_master where name = ?", (table,)).fetchone()
    except sqlite3.DatabaseError:
        return
    if rowid is None:
        return
    order = ["rowid"] if "without rowid" not in rowid[0] else key
    for direction in ("asc", "desc"):
        by = ", ".join(f"{column} {direction}" for column in order)
        try:
            for row in connection.execute(f"select * from {table} order by {by}"):
                if is_whole(row):
                    yield row
        except sqlite3.DatabaseError:
            continue
        return


def _name_new(path: Path) -> Path:
    return path.with_name(f"{path.name}.new")


def _find_free_name(path: Path) -> Path:
    names = (path.with_name(f"{path.stem}.damaged-{number}{path.suffix}") for number in itertools.count(1))
    return next(name for name in names if not name.exists())


def _remove(new: Path) -> None:
    for path in (new, new.with_name(new.name + "-journal")):
        path.unlink(missing_ok=True)
