"""Records of methods that were run alone on matches, in the same file as the others."""

from __future__ import annotations

from dataclasses import astuple
from typing import TYPE_CHECKING, NamedTuple

from cgroup.benchmark.cases import Problem
from cgroup.benchmark.records.rows import insert, insert_machine, list_origin
from cgroup.benchmark.records.schema import PENDING_TRIALS

if TYPE_CHECKING:
    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.records.store import Store
    from cgroup.benchmark.records.types import TrialRecord


class PendingProblem(NamedTuple):
    """A problem that methods are still to be run on; `entry` numbers the set that wants it."""

    case: Problem
    threads: int
    entry: int
    limit: float
    methods: tuple[Candidate, ...]


class Trials:
    """Problems, and what methods made of them.

    Parameters
    ----------
    store : Store
        Open for writing.
    """

    def __init__(self, store: Store) -> None:
        self._store = store

    def pending(self) -> list[PendingProblem]:
        """Problems to be grouped, with the methods that are missing, in the order of the plan."""
        fields = (
            "dataset, pair, kind, other, matches, voxel, epsilon, seed, w.threads, w.entry, w.time_limit, "
            "w.method_key"
        )
        methods = self._store.methods()
        found: dict[tuple[Problem, int, int, float], list[Candidate]] = {}
        for *case, threads, entry, limit, key in self._store.connection.execute(
            PENDING_TRIALS.format(fields)
        ):
            found.setdefault((Problem(*case), threads, entry, limit), []).append(methods[key])
        return [PendingProblem(*what, tuple(missing)) for what, missing in found.items()]

    def add(self, record: TrialRecord) -> None:
        """Store a record, in place of one of a call that was given up."""
        with self._store.transaction() as connection:
            insert_machine(connection, record.provenance)
            what = (record.case.key, record.method_key, record.threads, record.limit)
            problem = (record.n, record.correct, record.resolution, record.pr, record.overlap)
            group = (record.selected, record.selected_correct, record.posed, record.ok, record.complete)
            poses = (*astuple(record.errors), *astuple(record.best), record.offered)
            cost = (record.seconds, record.mebibytes, record.diagnostics, record.skipped, record.error)
            row = (*what, *problem, *group, *poses, *cost, *list_origin(record.provenance))
            insert(connection, "trials", *row, known="replace")
