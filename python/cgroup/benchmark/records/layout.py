"""The layout of the records' file: made, brought up to date, and told from others."""

from __future__ import annotations

import functools
import re
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

from cgroup.benchmark.records.checksums import checksum, decode_text
from cgroup.benchmark.records.schema import FRONT_SCHEMA, REGISTRATION_SCHEMA, SCHEMA, TRIAL_SCHEMA
from cgroup.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

_WITHOUT_CHECKSUMS = tuple(re.findall(r"create table (\w+)", SCHEMA + REGISTRATION_SCHEMA + TRIAL_SCHEMA))

_CHECKSUM_SCHEMA = "".join(f"alter table {table} add column checksum blob;\n" for table in _WITHOUT_CHECKSUMS)

ADDED = {1: SCHEMA, 2: REGISTRATION_SCHEMA, 3: TRIAL_SCHEMA, 4: _CHECKSUM_SCHEMA, 5: FRONT_SCHEMA}
"""What each version added; a file of an earlier one gets what it lacks."""

SCHEMA_VERSION = max(ADDED)

WITH_CHECKSUMS = 4
"""Rows bear a checksum, their last column, from this version on."""


def list_tables(version: int) -> tuple[str, ...]:
    """Names of all tables of a version."""
    schemas = (schema for added_in, schema in ADDED.items() if added_in <= version)
    return tuple(re.findall(r"create table (\w+)", "".join(schemas)))


TABLES = list_tables(SCHEMA_VERSION)
"""Names of all tables."""


def prepare_layout(connection: sqlite3.Connection, path: Path) -> None:
    """Make the layout in an empty file, or bring that of an earlier version up to date.

    Raises
    ------
    InputError
        If the file has another layout.
    """
    version = read_version(connection)
    if version == SCHEMA_VERSION:
        return
    if version or not is_empty(connection):
        check_version(version, path)
    _add_versions(connection, version, SCHEMA_VERSION)
    if 0 < version < WITH_CHECKSUMS:
        _add_checksums(connection)


def check_version(version: int, path: Path) -> None:
    """Raise `InputError` for a layout that isn't known."""
    if version == 0:
        message = f"{path}: not a file of records; use another folder, or move the file away"
        raise InputError(message)
    if version not in ADDED:
        message = (
            f"{path}: its layout is number {version}, this version of cgroup knows {SCHEMA_VERSION}; "
            "use the version that made it, or another folder"
        )
        raise InputError(message)


def read_version(connection: sqlite3.Connection) -> int:
    """Read the number of a file's layout; 0 where it has none."""
    return connection.execute("pragma user_version").fetchone()[0]


def is_empty(connection: sqlite3.Connection) -> bool:
    """Tell whether there is nothing in a file."""
    return connection.execute("select count(*) from sqlite_master").fetchone()[0] == 0


def find_changed(connection: sqlite3.Connection) -> list[str]:
    """Find tables and views that aren't as the file's version makes them."""
    found, expected = _read_definitions(connection), _expected_definitions(read_version(connection))
    return sorted(name for name in found.keys() | expected.keys() if found.get(name) != expected.get(name))


@functools.cache
def _expected_definitions(version: int) -> dict[str, str]:
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as connection:
        _add_versions(connection, 0, version)
        return _read_definitions(connection)


def _read_definitions(connection: sqlite3.Connection) -> dict[str, str]:
    connection.text_factory = decode_text
    rows = connection.execute("select name, sql from sqlite_master where sql is not null").fetchall()
    return {name: " ".join(re.sub("--.*", "", text).split()) for name, text in rows}


def list_columns(connection: sqlite3.Connection, table: str) -> tuple[list[str], list[str]]:
    """Names of a table's columns, and those of its key."""
    rows = connection.execute(f"pragma table_info({table})").fetchall()
    return [row[1] for row in rows], [row[1] for row in sorted(rows, key=lambda row: row[5]) if row[5]]


def _add_versions(connection: sqlite3.Connection, version: int, to: int) -> None:
    """Add what later versions have."""
    lacking = "".join(schema for added_in, schema in ADDED.items() if version < added_in <= to)
    for statement in lacking.split(";\n"):
        connection.execute(statement)
    connection.execute(f"pragma user_version = {to}")


def _add_checksums(connection: sqlite3.Connection) -> None:
    """Give rows of earlier versions theirs."""
    connection.create_function("checksum_of", -1, lambda *row: checksum(row))
    for table in list_tables(WITH_CHECKSUMS):
        *columns, _ = list_columns(connection, table)[0]
        connection.execute(f"update {table} set checksum = checksum_of({', '.join(columns)})")
