"""Records of the timing experiment, in the same file as the others."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.records.rows import insert, insert_machine, insert_method

if TYPE_CHECKING:
    from collections.abc import Iterable

    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.records.store import Store
    from cgroup.benchmark.records.types import Provenance


class Timings:
    """Sets of correspondences, and the times of methods on them.

    Parameters
    ----------
    store : Store
        Open for writing.
    """

    def __init__(self, store: Store) -> None:
        self._store = store

    def content(self, key: str) -> bytes | None:
        """Packed correspondences of a set for the timing experiment, if it has been made."""
        query = "select content from timing_sets where key = ?"
        row = self._store.connection.execute(query, (key,)).fetchone()
        return None if row is None else row[0]

    def add_set(self, key: str, dataset: str, pair: str, size: int, n: int, content: bytes) -> None:
        """Store such a set."""
        with self._store.transaction() as connection:
            insert(connection, "timing_sets", key, dataset, pair, size, n, content)

    def ask_for(self, set_key: str, methods: Iterable[Candidate]) -> None:
        """Ask for times of methods on a set."""
        with self._store.transaction() as connection:
            for position, method in enumerate(methods):
                insert_method(connection, method)
                insert(connection, "plan_timing", set_key, method.key, method.label, position)

    def seconds(self, set_key: str, method_key: str, threads: int, machine: str) -> list[float]:
        """Read the times that have been taken, in order."""
        query = """
        select seconds from timings
        where set_key = ? and method_key = ? and threads = ? and machine = ? order by repeat
        """
        where = (set_key, method_key, threads, machine)
        return [row[0] for row in self._store.connection.execute(query, where)]

    def add_seconds(
        self, set_key: str, method_key: str, threads: int, provenance: Provenance, seconds: list[float]
    ) -> None:
        """Store the times of all repeats in place of earlier ones; a reason to skip no longer holds."""
        where = (set_key, method_key, threads, provenance.machine.id)
        with self._store.transaction() as connection:
            insert_machine(connection, provenance)
            for table in ("timings", "timing_skips"):
                connection.execute(
                    f"delete from {table} "
                    "where set_key = ? and method_key = ? and threads = ? and machine = ?",
                    where,
                )
            for repeat, value in enumerate(seconds):
                insert(connection, "timings", *where, repeat, value, provenance.version, provenance.created)

    def skip(self, set_key: str, method_key: str, threads: int, provenance: Provenance, reason: str) -> None:
        """Store why no time is taken."""
        where = (set_key, method_key, threads, provenance.machine.id)
        with self._store.transaction() as connection:
            insert_machine(connection, provenance)
            insert(connection, "timing_skips", *where, reason, known="replace")
