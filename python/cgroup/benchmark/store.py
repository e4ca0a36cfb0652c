"""Records in one SQLite file: what has been computed, and what the latest configuration asks for.

Computed records stay for good, under keys made from what they depend on. The plan, that is which cases,
methods and thresholds the experiments ask for, is replaced by each run; what is missing follows from both.
"""

from __future__ import annotations

import itertools
import json
import sqlite3
from contextlib import closing, contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Literal, NamedTuple

from cgroup.benchmark.candidates import Candidate
from cgroup.benchmark.cases import Case
from cgroup.benchmark.schema import (
    CASE_ORDER,
    PENDING_CASES,
    PENDING_GROUPINGS,
    PENDING_SCORES,
    SCHEMA,
    SCHEMA_VERSION,
)
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator
    from pathlib import Path

    from cgroup.benchmark.plan import DatasetFacts, Plan, PlannedExperiment
    from cgroup.benchmark.results import Grouped, Matched, Provenance, Scored

RECORDS = "records.sqlite"
"""Name of the file in a run's folder."""


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
        with self._transaction() as connection:
            version = connection.execute("pragma user_version").fetchone()[0]
            if version == SCHEMA_VERSION:
                return
            if version != 0 or connection.execute("select count(*) from sqlite_master").fetchone()[0]:
                message = (
                    f"{self.path}: its layout is number {version}, this version of cgroup writes "
                    f"{SCHEMA_VERSION}; use another folder"
                )
                raise InputError(message)
            for statement in SCHEMA.split(";\n"):
                connection.execute(statement)
            connection.execute(f"pragma user_version = {SCHEMA_VERSION}")

    @contextmanager
    def _transaction(self) -> Generator[sqlite3.Connection, None, None]:
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
        with self._transaction() as connection:
            for table in ("", "_experiments", "_cases", "_methods", "_epsilons", "_timing"):
                connection.execute(f"delete from plan{table}")
            config = plan.config
            missing = json.dumps(plan.missing)
            _insert(connection, "plan", config.name, config.seed, config.model_dump_json(), missing)
            for facts in plan.datasets:
                _insert_dataset(connection, facts)
            pairs = {facts.name: facts.pairs for facts in plan.datasets}
            for entry, planned in enumerate(plan.experiments):
                _insert_experiment(connection, entry, planned, pairs)

    def forget_failures(self) -> None:
        """Drop the records of what failed, so that it is tried again."""
        with self._transaction() as connection:
            connection.execute("delete from correspondences where error <> ''")
            connection.execute("delete from groupings where error <> ''")

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
            "correspond": self._count(
                "wanted_cases", "correspondences", "using (case_key)", "coalesce(r.error, '') <> ''"
            ),
            "group": self._count(
                "wanted_groupings", "groupings", "using (case_key, method_key)", "coalesce(r.error, '') <> ''"
            ),
            "score": self._count("wanted_scores", "scores", "using (case_key, method_key, epsilon)", "0"),
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
        """Read what failed: the method (empty for the first stage), the error, and how often."""
        query = """
        select '', error, count(*) from wanted_cases join correspondences using (case_key)
        where error <> '' group by error
        union all
        select label, error, count(*) from groupings join (
            select case_key, method_key, min(label) as label
            from plan_cases join plan_methods using (entry) group by case_key, method_key
        ) using (case_key, method_key)
        where error <> '' group by label, error
        order by 3 desc
        """
        return list(self.connection.execute(query))

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

    def add_matched(self, records: Iterable[Matched]) -> None:
        """Store records of the first stage, all or none."""
        with self._transaction() as connection:
            for record in records:
                _insert_machine(connection, record.provenance)
                key = record.case.key
                facts = (record.n, record.pr, record.facts, record.seconds, record.parameters, record.error)
                _insert(connection, "correspondences", key, *facts, *_origin(record.provenance))
                if not record.error:
                    _insert(connection, "arrays", key, record.content, record.truth, record.sample)

    def add_grouped(self, records: Iterable[Grouped]) -> None:
        """Store records of the second stage, all or none."""
        with self._transaction() as connection:
            for record in records:
                _insert_machine(connection, record.provenance)
                result = (record.mask, record.seconds, record.threshold, record.pose, record.diagnostics)
                how = (record.parameters, record.error, *_origin(record.provenance))
                _insert(connection, "groupings", record.case_key, record.method_key, *result, *how)

    def add_scored(self, records: Iterable[Scored]) -> None:
        """Store records of the third stage, all or none."""
        with self._transaction() as connection:
            for record in records:
                _insert(connection, "scores", *vars(record).values())

    # --- timing ----------------------------------------------------------------------------------

    def timing_set(self, key: str) -> bytes | None:
        """Packed correspondences of a set for the timing experiment, if it has been made."""
        row = self.connection.execute("select content from timing_sets where key = ?", (key,)).fetchone()
        return None if row is None else row[0]

    def add_timing_set(self, key: str, dataset: str, pair: str, size: int, n: int, content: bytes) -> None:
        """Store such a set."""
        with self._transaction() as connection:
            _insert(connection, "timing_sets", key, dataset, pair, size, n, content)

    def plan_timing(self, set_key: str, methods: Iterable[Candidate]) -> None:
        """Ask for times of methods on a set."""
        with self._transaction() as connection:
            for place, method in enumerate(methods):
                _insert_method(connection, method)
                _insert(connection, "plan_timing", set_key, method.key, method.label, place)

    def seconds(self, set_key: str, method_key: str, threads: int, machine: str) -> list[float]:
        """Read the times that have been taken, in order."""
        query = """
        select seconds from timings
        where set_key = ? and method_key = ? and threads = ? and machine = ? order by repeat
        """
        return [row[0] for row in self.connection.execute(query, (set_key, method_key, threads, machine))]

    def add_seconds(
        self, set_key: str, method_key: str, threads: int, provenance: Provenance, seconds: list[float]
    ) -> None:
        """Store the times of all repeats in place of earlier ones; a reason to skip no longer holds."""
        where = (set_key, method_key, threads, provenance.machine.id)
        with self._transaction() as connection:
            _insert_machine(connection, provenance)
            for table in ("timings", "timing_skips"):
                connection.execute(
                    f"delete from {table} "
                    "where set_key = ? and method_key = ? and threads = ? and machine = ?",
                    where,
                )
            for repeat, value in enumerate(seconds):
                _insert(connection, "timings", *where, repeat, value, provenance.version, provenance.created)

    def skip_timing(
        self, set_key: str, method_key: str, threads: int, provenance: Provenance, reason: str
    ) -> None:
        """Store why no time is taken."""
        where = (set_key, method_key, threads, provenance.machine.id)
        with self._transaction() as connection:
            _insert_machine(connection, provenance)
            _insert(connection, "timing_skips", *where, reason, known="replace")


@contextmanager
def only_writer(folder: Path) -> Generator[None, None, None]:
    """Keep other runs off a folder; the lock goes with the process, however it ends.

    Raises
    ------
    InputError
        If another run works in the folder, or it can't be written to.
    """
    path = folder / "lock.sqlite"
    try:
        lock = sqlite3.connect(path, isolation_level=None, timeout=0)
    except sqlite3.Error as error:
        message = f"{folder}: can't be written to ({error})"
        raise InputError(message) from error
    with closing(lock):
        try:
            lock.execute("begin exclusive")
        except sqlite3.OperationalError as error:
            message = f"{folder}: another run is at work there ({error}); wait for it or use another folder"
            raise InputError(message) from error
        yield


def _insert_dataset(connection: sqlite3.Connection, facts: DatasetFacts) -> None:
    row = (facts.name, facts.title, facts.role, facts.origin, facts.citation)
    _insert(connection, "datasets", *row, known="replace")


def _insert_experiment(
    connection: sqlite3.Connection,
    entry: int,
    planned: PlannedExperiment,
    pairs: dict[str, dict[str, tuple[str, tuple[str, ...]]]],
) -> None:
    experiment = planned.experiment
    _insert(connection, "plan_experiments", entry, experiment.id, experiment.model_dump_json())
    for case in planned.cases:
        origin, protocols = pairs[case.dataset][case.pair]
        pair = (case.dataset, case.pair, origin, json.dumps(protocols), case.nuisance, case.level)
        front = (case.combination, case.detector, case.descriptor, case.nms_radius, case.seed)
        _insert(connection, "cases", case.key, *pair, *front, known="replace")
        _insert(connection, "plan_cases", entry, case.key, known="ignore")
    for place, method in enumerate(planned.methods):
        _insert_method(connection, method)
        _insert(connection, "plan_methods", entry, method.key, method.label, place, known="ignore")
    for epsilon in experiment.epsilons:
        _insert(connection, "plan_epsilons", entry, epsilon, known="ignore")


def _insert_method(connection: sqlite3.Connection, method: Candidate) -> None:
    _insert(connection, "methods", method.key, method.name, method.options, known="ignore")


def _insert_machine(connection: sqlite3.Connection, provenance: Provenance) -> None:
    machine = provenance.machine
    _insert(connection, "machines", machine.id, *asdict(machine).values(), known="ignore")


def _insert(
    connection: sqlite3.Connection,
    table: str,
    *row: object,
    known: Literal["abort", "ignore", "replace"] = "abort",
) -> None:
    """Add a row; `known` says what to do where its key is taken."""
    marks = ", ".join("?" * len(row))
    connection.execute(f"insert or {known} into {table} values ({marks})", row)


def _origin(provenance: Provenance) -> tuple[str, str, str]:
    return provenance.version, provenance.machine.id, provenance.created
