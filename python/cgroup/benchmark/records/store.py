"""Records in one SQLite file: what has been computed, and what the latest configuration asks for.

Computed records stay for good, under keys made from what they depend on. The plan, that is which cases,
methods and thresholds the experiments ask for, is replaced by each run; what is missing follows from both.
"""

from __future__ import annotations

import itertools
import json
import sqlite3
from contextlib import contextmanager
from typing import TYPE_CHECKING, NamedTuple

from cgroup.benchmark.candidates import Candidate
from cgroup.benchmark.cases import Case
from cgroup.benchmark.records.rows import (
    insert,
    insert_dataset,
    insert_experiment,
    insert_machine,
    insert_set,
    insert_trials,
    list_origin,
)
from cgroup.benchmark.records.schema import (
    ADDED,
    CASE_ORDER,
    FAILURES,
    PENDING_CASES,
    PENDING_GROUPINGS,
    PENDING_SCORES,
    PLAN_TABLES,
    SCHEMA_VERSION,
)
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator
    from pathlib import Path

    from cgroup.benchmark.plan import Plan
    from cgroup.benchmark.records.types import GroupingRecord, MatchingRecord, ScoreRecord

RECORDS = "records.sqlite"
"""Name of the file in a run's folder."""

_FAILED = "coalesce(r.error, '') <> ''"


class Counts(NamedTuple):
    """How far one stage is."""

    done: int
    failed: int
    wanted: int


class Store:
    """The records of one folder. One process writes; any number may read.

    Parameters
    ----------
    path : path
        The SQLite file; made if it doesn't exist.

    Raises
    ------
    InputError
        If the file isn't one of this version.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self.connection = sqlite3.connect(path, isolation_level=None, timeout=30)
            self.connection.execute("pragma journal_mode = wal")
            self.connection.execute("pragma synchronous = normal")
            self._prepare()
            # Worker pools ask for the next task from threads of their own, one at a time.
            self._reader = sqlite3.connect(path, isolation_level=None, check_same_thread=False, timeout=30)
        except sqlite3.Error as error:
            message = f"{path}: can't be used as a store of records: {error}"
            raise InputError(message) from error

    def close(self) -> None:
        """Close the file."""
        self._reader.close()
        self.connection.close()

    def _prepare(self) -> None:
        with self.transaction() as connection:
            version = connection.execute("pragma user_version").fetchone()[0]
            if version == SCHEMA_VERSION:
                return
            empty = connection.execute("select count(*) from sqlite_master").fetchone()[0] == 0
            if version not in ADDED and not (version == 0 and empty):
                message = (
                    f"{self.path}: its layout is number {version}, this version of cgroup writes "
                    f"{SCHEMA_VERSION}; use another folder"
                )
                raise InputError(message)
            lacking = "".join(schema for added_in, schema in ADDED.items() if added_in > version)
            for statement in lacking.split(";\n"):
                connection.execute(statement)
            connection.execute(f"pragma user_version = {SCHEMA_VERSION}")

    @contextmanager
    def transaction(self) -> Generator[sqlite3.Connection, None, None]:
        """Write all that follows, or, after an error, none of it."""
        self.connection.execute("begin immediate")
        try:
            yield self.connection
        except BaseException:
            self.connection.execute("rollback")
            raise
        self.connection.execute("commit")

    # --- plan ------------------------------------------------------------------------------------

    def replace_plan(self, plan: Plan) -> None:
        """Ask for what a configuration asks for, and nothing else."""
        with self.transaction() as connection:
            for table in PLAN_TABLES:
                connection.execute(f"delete from {table}")
            config = plan.config
            missing = json.dumps(plan.missing)
            insert(connection, "plan", config.name, config.seed, config.model_dump_json(), missing)
            for facts in plan.datasets:
                insert_dataset(connection, facts)
            pairs = {facts.name: facts.pairs for facts in plan.datasets}
            for entry, planned in enumerate(plan.experiments):
                insert_experiment(connection, entry, planned, pairs)
            for entry, planned in enumerate(plan.sets):
                insert_set(connection, entry, planned, pairs)
            for entry, planned in enumerate(plan.trials):
                insert_trials(connection, entry, planned, pairs)

    def forget_failures(self) -> None:
        """Drop the records of what failed, so that it is tried again."""
        with self.transaction() as connection:
            connection.execute("delete from correspondences where error <> ''")
            connection.execute("delete from groupings where error <> ''")
            connection.execute("delete from registrations where error <> ''")
            connection.execute("delete from trials where error <> ''")

    # --- what is missing -------------------------------------------------------------------------

    def pending_cases(self, at_most: int) -> list[tuple[Case, ...]]:
        """Cases to be matched, in parts of the same pair that are not too large."""
        fields = "dataset, pair, nuisance, level, combination, nms_radius, seed"
        rows = self.connection.execute(f"{PENDING_CASES.format(fields)} {CASE_ORDER}")
        parts: list[tuple[Case, ...]] = []
        for _, same_pair in itertools.groupby((Case(*row) for row in rows), lambda c: (c.dataset, c.pair)):
            cases = iter(same_pair)
            while part := tuple(itertools.islice(cases, at_most)):
                parts.append(part)
        return parts

    def pending_groupings(self) -> list[tuple[str, int, tuple[Candidate, ...]]]:
        """Cases to be grouped: key, seed and the methods that are missing."""
        query = f"{PENDING_GROUPINGS.format('w.case_key, seed, w.method_key')} {CASE_ORDER}, w.method_key"
        methods = self.methods()
        found: dict[tuple[str, int], list[Candidate]] = {}
        for case_key, seed, method_key in self.connection.execute(query):
            found.setdefault((case_key, seed), []).append(methods[method_key])
        return [(case_key, seed, tuple(missing)) for (case_key, seed), missing in found.items()]

    def pending_scores(self) -> dict[str, dict[str, list[float]]]:
        """Thresholds at which groupings are to be judged, by case and method."""
        query = PENDING_SCORES.format("w.case_key, w.method_key, w.epsilon")
        found: dict[str, dict[str, list[float]]] = {}
        for case_key, method_key, epsilon in self.connection.execute(query):
            found.setdefault(case_key, {}).setdefault(method_key, []).append(epsilon)
        return found

    def methods(self) -> dict[str, Candidate]:
        """Every method that was ever asked for, by key."""
        rows = self.connection.execute("select key, name, options from methods")
        return {key: Candidate(name, name, options) for key, name, options in rows}

    def counts(self) -> dict[str, Counts]:
        """How far the stages are with what the plan asks for."""
        return {
            "correspond": self._count("wanted_cases", "correspondences", "using (case_key)", _FAILED),
            "group": self._count("wanted_groupings", "groupings", "using (case_key, method_key)", _FAILED),
            "score": self._count("wanted_scores", "scores", "using (case_key, method_key, epsilon)", "0"),
            "register": self._count(
                "wanted_registrations", "registrations", "using (case_key, pipeline_key, threads)", _FAILED
            ),
            "try": self._count("wanted_trials", "trials", "using (case_key, method_key, threads)", _FAILED),
        }

    def _count(self, wanted: str, records: str, match: str, failed: str) -> Counts:
        query = (
            f"select count(r.case_key), coalesce(sum({failed}), 0), count(*) "
            f"from {wanted} left join {records} r {match}"
        )
        done, bad, total = self.connection.execute(query).fetchone()
        return Counts(done - bad, bad, total)

    def missing(self) -> dict[str, str]:
        """Read which data sets aren't at hand, and why."""
        return json.loads(self.connection.execute("select missing from plan").fetchone()[0])

    def failures(self) -> list[tuple[str, str, int]]:
        """Read what failed: the method or pipeline (empty for the first stage), the error, and how often."""
        return list(self.connection.execute(FAILURES))

    # --- records ---------------------------------------------------------------------------------

    def content(self, case_key: str) -> bytes:
        """Packed correspondences of a case; may be called from any thread, one at a time."""
        query = "select content from arrays where case_key = ?"
        return self._reader.execute(query, (case_key,)).fetchone()[0]

    def truth(self, case_key: str) -> tuple[bytes, bytes, bytes, tuple[str, ...]]:
        """Packed correspondences, true pose and overlap sample of a case, and its protocols."""
        query = """
        select content, truth, sample, protocols from arrays join cases on cases.key = case_key
        where case_key = ?
        """
        content, truth, sample, protocols = self.connection.execute(query, (case_key,)).fetchone()
        return content, truth, sample, tuple(json.loads(protocols))

    def groupings(self, case_key: str) -> Iterator[tuple[str, bytes, bytes | None]]:
        """Read method, mask and pose of every grouping of a case that went well."""
        query = "select method_key, mask, pose from groupings where case_key = ? and error = ''"
        yield from self.connection.execute(query, (case_key,))

    def add_matchings(self, records: Iterable[MatchingRecord]) -> None:
        """Store records of the first stage, all or none."""
        with self.transaction() as connection:
            for record in records:
                insert_machine(connection, record.provenance)
                key = record.case.key
                facts = (record.n, record.pr, record.facts, record.seconds, record.parameters, record.error)
                insert(connection, "correspondences", key, *facts, *list_origin(record.provenance))
                if not record.error:
                    insert(connection, "arrays", key, record.content, record.truth, record.sample)

    def add_groupings(self, records: Iterable[GroupingRecord]) -> None:
        """Store records of the second stage, all or none."""
        with self.transaction() as connection:
            for record in records:
                insert_machine(connection, record.provenance)
                result = (record.mask, record.seconds, record.threshold, record.pose, record.diagnostics)
                how = (record.parameters, record.error, *list_origin(record.provenance))
                insert(connection, "groupings", record.case_key, record.method_key, *result, *how)

    def add_scores(self, records: Iterable[ScoreRecord]) -> None:
        """Store records of the third stage, all or none."""
        with self.transaction() as connection:
            for record in records:
                insert(connection, "scores", *vars(record).values())
