"""Reading the file of results of a run."""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Generator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cgroup._checks.values import as_path
from cgroup._runtime.sqlite import is_empty
from cgroup.benchmark.store import RECORDS, RECORDS_LAYOUT, foreign_records
from cgroup.errors import InputError

if TYPE_CHECKING:  # slow to load, and workers do without
    import pandas as pd

_FLOATS = ("level", "nms_radius", "voxel", "epsilon", "seconds")
"""Columns of numbers that may all be missing."""


def query(path: Path, statement: str, parameters: tuple[str, ...] = ()) -> pd.DataFrame:
    """Return the rows of a statement."""
    import pandas as pd  # noqa: PLC0415 - slow to load, and workers do without

    with open_records(path) as connection:
        cursor = connection.execute(statement, parameters)
        columns = [column[0] for column in cursor.description]
        frame = pd.DataFrame.from_records(cursor.fetchall(), columns=columns, coerce_float=True)
    return frame.astype({name: float for name in _FLOATS if name in frame})


def read_plan(path: Path, column: str) -> Any:  # noqa: ANN401 - any JSON
    """Return a column of the plan."""
    with open_records(path) as connection:
        row = connection.execute(f"select {column} from plan").fetchone()
    if row is None:
        raise _absent(path)
    return json.loads(row[0])


@contextmanager
def open_records(path: Path | str) -> Generator[sqlite3.Connection, None, None]:
    """Open the results for reading; a run may write meanwhile."""
    path = as_path("path", path)
    file = path / RECORDS if path.is_dir() else path
    if not file.exists() or not file.stat().st_size:
        raise _absent(path)
    # Also in a folder where SQLite can't make files of its own.
    alone = not os.access(file.parent, os.W_OK) and not file.with_name(file.name + "-wal").exists()
    address = f"{file.absolute().as_uri()}?mode=ro{'&immutable=1' if alone else ''}"
    try:
        with closing(sqlite3.connect(address, uri=True, timeout=30)) as connection:
            if is_empty(connection):
                raise _absent(path)
            RECORDS_LAYOUT.check(connection, foreign_records(file))
            yield connection
    except sqlite3.Error as error:
        message = (
            f"{file}: not a file of records, or one that can't be read ({error}); the next run computes all "
            "results again"
        )
        raise InputError(message) from error


def _absent(path: Path) -> InputError:
    file = path / RECORDS if path.is_dir() else path
    return InputError(f"{file}: no records; make some with: cgroup benchmark run smoke --out {path}")
