"""Open SQLite files, create missing files, and reject foreign ones."""

import sqlite3
from pathlib import Path
from typing import NamedTuple

_SECONDS_OF_OTHERS = 60  # for which another process may be at work on a file


class Layout(NamedTuple):
    """Layout of a file: its `application_id`, its `user_version`, and the statements that create it."""

    application: int
    version: int
    schema: str

    def check(self, connection: sqlite3.Connection, foreign: Exception) -> None:
        """Raise `foreign` for a file of another layout."""
        names = ("application_id", "user_version")
        found = tuple(connection.execute(f"pragma {name}").fetchone()[0] for name in names)
        if found != (self.application, self.version):
            raise foreign


def is_empty(connection: sqlite3.Connection) -> bool:
    """Return whether a file is empty."""
    return connection.execute("select count(*) from sqlite_master").fetchone()[0] == 0


def open_or_make(path: Path, layout: Layout, foreign: Exception) -> sqlite3.Connection:
    """Open a file for writing; for a file of another program, raise `foreign` and leave it unchanged."""
    # Any thread may use the connection, one at a time.
    connection = sqlite3.connect(
        path, isolation_level=None, timeout=_SECONDS_OF_OTHERS, check_same_thread=False
    )
    try:
        connection.execute("begin immediate")  # another process may make it, too
        if is_empty(connection):
            for statement in layout.schema.split(";\n"):
                connection.execute(statement)
            connection.execute(f"pragma application_id = {layout.application}")
            connection.execute(f"pragma user_version = {layout.version}")
        layout.check(connection, foreign)
        connection.execute("commit")
        connection.execute("pragma journal_mode = wal")
        connection.execute("pragma synchronous = normal")
    except BaseException:
        connection.close()
        raise
    return connection
