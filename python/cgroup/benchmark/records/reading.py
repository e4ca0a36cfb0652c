"""The records' file opened for reading, whether or not a run is writing to it."""

# pandas ships no types.
# pyright: reportArgumentType=false

from __future__ import annotations

import functools
import json
import os
import sqlite3
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any

from cgroup.benchmark.records.integrity import Health, examine, find_damaged
from cgroup.benchmark.records.layout import (
    WITH_CHECKSUMS,
    check_version,
    find_changed,
    is_empty,
    list_tables,
    read_version,
)
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Generator
    from pathlib import Path

    import pandas as pd

RECORDS = "records.sqlite"
"""Name of the file in a run's folder."""

_LARGE = ("arrays", "timing_sets")  # what they hold is examined where it is read
_NAMED = 3  # damaged records in a message


def query(path: Path, text: str) -> pd.DataFrame:
    """Read what an SQL statement selects; raises `InputError` if there are no records, or damaged ones."""
    import pandas as pd  # noqa: PLC0415 - slow to load, and workers do without

    with open_records(path) as connection:
        try:
            return pd.read_sql_query(text, connection)
        except pd.errors.DatabaseError as error:
            raise _unreadable(find_file(path), error) from error


def query_one(path: Path, text: str) -> Any:  # noqa: ANN401 - whatever the column holds
    """Read the first column of the only row; raises `InputError` where there is none."""
    with open_records(path) as connection:
        row = connection.execute(text).fetchone()
    if row is None:
        raise _absent(find_file(path), path)
    return row[0]


def has_table(path: Path, name: str) -> bool:
    """Tell whether the records have a table; those of older versions lack some."""
    with open_records(path) as connection:
        found = connection.execute("select count(*) from sqlite_master where name = ?", (name,))
        return bool(found.fetchone()[0])


def parse_json(text: str) -> Any:  # noqa: ANN401 - whatever it says
    """Read a column that holds JSON."""
    try:
        return json.loads(text)
    except ValueError as error:
        message = f"records: no JSON where there should be some ({error}); see: cgroup benchmark check"
        raise InputError(message) from error


@contextmanager
def open_records(path: Path, *, damaged: bool = False) -> Generator[sqlite3.Connection, None, None]:
    """Open the records of a folder, or a file, for reading; a run may write to them meanwhile.

    Raises
    ------
    InputError
        If there are none, they can't be read, have another layout or, unless `damaged` ones are welcome,
        some aren't what was written.
    """
    file = find_file(path)
    try:
        size = file.stat().st_size
    except OSError as error:
        raise _absent(file, path) from error
    if not size:
        raise _absent(file, path)
    try:
        with closing(sqlite3.connect(_make_address(file), uri=True, timeout=30)) as connection:
            version = read_version(connection)
            if version == 0 and is_empty(connection):
                raise _absent(file, path)
            check_version(version, file)
            if not damaged and version >= WITH_CHECKSUMS:
                _refuse_damaged(file, *_find_state(file))
            yield connection
    except sqlite3.Error as error:
        raise _unreadable(file, error) from error


def check(path: Path) -> Health:
    """Read all records, and say whether they are what was written.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    Health
        How many rows of which table are whole, and what isn't.

    Raises
    ------
    InputError
        If there are no records, or they have another layout.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark import records
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gtm"], experiment=[small])
    >>> _ = run(config, Path("results"), backend="threading")
    >>> records.check(Path("results")).whole["groupings"]
    2
    """
    with open_records(path, damaged=True) as connection:
        return examine(connection)


def find_file(path: Path) -> Path:
    """Path of the records' file in a folder; a file is its own."""
    return path / RECORDS if path.is_dir() else path


def describe_damage(file: Path, names: list[str]) -> str:
    """Say which records are damaged, and what to do."""
    listed = "; ".join(names[:_NAMED]) + ("; ..." if len(names) > _NAMED else "")
    return (
        f"{file}: {len(names)} damaged ({listed}); run the same configuration again to compute them anew, "
        f"or see: cgroup benchmark check --out {file.parent}"
    )


@functools.lru_cache(maxsize=1)
def _refuse_damaged(file: Path, *_state: object) -> None:
    """Raise `InputError` for damaged rows; once for each state of the file."""
    with closing(sqlite3.connect(_make_address(file), uri=True, timeout=30)) as connection:
        tables = [table for table in list_tables(read_version(connection)) if table not in _LARGE]
        names = find_changed(connection) or [
            each.name for table in tables for each in find_damaged(connection, table)
        ]
    if names:
        raise InputError(describe_damage(file, names))


def _find_state(file: Path) -> tuple[object, ...]:
    """Find what changes with every change of the records."""
    log = file.with_name(file.name + "-wal")
    stats = [each.stat() for each in (file, log) if each.exists()]
    return tuple((each.st_ino, each.st_mtime_ns, each.st_size) for each in stats)


def _make_address(file: Path) -> str:
    """Address for reading, also in a folder where SQLite can't make files of its own."""
    log = file.with_name(file.name + "-wal")
    alone = not os.access(file.parent, os.W_OK) and not log.exists()
    return f"{file.absolute().as_uri()}?mode=ro{'&immutable=1' if alone else ''}"


def _absent(file: Path, path: Path) -> InputError:
    return InputError(f"{file}: no records; make some with: cgroup benchmark run smoke --out {path}")


def _unreadable(file: Path, error: Exception) -> InputError:
    return InputError(f"{file}: not a file of records, or one that can't be read: {error}")
