"""Whether records are what was written: every row by its checksum, the file by SQLite's own check."""

from __future__ import annotations

import sqlite3
from typing import TYPE_CHECKING, NamedTuple

from cgroup.benchmark.records.checksums import decode_text, is_whole
from cgroup.benchmark.records.layout import (
    WITH_CHECKSUMS,
    find_changed,
    list_columns,
    list_tables,
    read_version,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

PAIRS = "select dataset, pair from {} where key = ?"
_CASES = ("cases", "pair_cases", "problems", "timing_sets")
_FAULTS_SHOWN = 10


class Damaged(NamedTuple):
    """A row that isn't what was written.

    Attributes
    ----------
    table : str
        Where it stands.
    name : str
        Table, key, and the pair that it is about where that is known.
    """

    table: str
    name: str


class Health(NamedTuple):
    """What an examination found.

    Attributes
    ----------
    whole : dict of str to int
        Rows of each table that are what was written.
    damaged : list of Damaged
        Those that aren't.
    faults : list of str
        What SQLite says of the file; empty where it is in order.
    """

    whole: dict[str, int]
    damaged: list[Damaged]
    faults: list[str]

    @property
    def sound(self) -> bool:
        """Whether nothing is amiss."""
        return not self.damaged and not self.faults


def examine(connection: sqlite3.Connection) -> Health:
    """Read all records, and compare them with their checksums; those of earlier versions have none."""
    faults = _check_file(connection)
    whole: dict[str, int] = {}
    damaged: list[Damaged] = []
    version = read_version(connection)
    with_checksums = version >= WITH_CHECKSUMS
    if with_checksums and not faults:
        faults += [f"{name}: its definition isn't what was written" for name in find_changed(connection)]
    for table in list_tables(version) if with_checksums else ():
        try:
            amiss = list(find_damaged(connection, table))
            rows = connection.execute(f"select count(*) from {table}").fetchone()[0]
        except sqlite3.DatabaseError as error:
            faults.append(f"{table}: {error}")
            continue
        damaged += amiss
        whole[table] = rows - len(amiss)
    return Health(whole, damaged, list(dict.fromkeys(faults)))


def find_damaged(connection: sqlite3.Connection, table: str) -> Iterator[Damaged]:
    """Find the rows of a table that aren't what was written."""
    connection.text_factory = decode_text
    columns, key = list_columns(connection, table)
    for row in connection.execute(f"select * from {table}"):
        if not is_whole(row):
            named = dict(zip(columns, row, strict=True))
            yield Damaged(table, _name(connection, table, [named[column] for column in key]))


def _name(connection: sqlite3.Connection, table: str, key: list[object]) -> str:
    text = " ".join([table, *map(_show, key)])
    for cases in _CASES if key else ():
        found = connection.execute(PAIRS.format(cases), (_show(key[0]),)).fetchone()
        if found:
            return f"{text} ({_show(found[0])} {_show(found[1])})"
    return text


def _show(value: object) -> str:
    """Text that can be printed, whatever became of the column."""
    text = value if isinstance(value, str) else repr(value)
    return text.encode("ascii", "backslashreplace").decode("ascii")


def _check_file(connection: sqlite3.Connection) -> list[str]:
    try:
        rows = connection.execute(f"pragma integrity_check({_FAULTS_SHOWN})").fetchall()
    except sqlite3.DatabaseError as error:
        return [str(error)]
    said = [" ".join(str(row[0]).split()) for row in rows]
    return [] if said == ["ok"] else said
