"""Records in one SQLite file: what has been computed, and what the latest configuration asks for.

Computed records stay for good, under keys made from what they depend on. The plan, that is which cases,
methods and thresholds the experiments ask for, is replaced by each run; what is missing follows from both.
"""

from __future__ import annotations

import itertools
import json
import sqlite3
from contextlib import contextmanager
from typing import TYPE_CHECKING

from cgroup.benchmark.candidates import Candidate
from cgroup.benchmark.cases import Case
from cgroup.benchmark.records.layout import prepare_layout
from cgroup.benchmark.records.progress import Counts, count_records
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
    CASE_ORDER,
    PENDING_CASES,
    PENDING_GROUPINGS,
    PENDING_SCORES,
    PLAN_TABLES,
)
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator
    from pathlib import Path

    from cgroup.benchmark.plan import Plan
    from cgroup.benchmark.records.types import GroupingRecord, MatchingRecord, ScoreRecord


@contextmanager
def report_failures(path: Path) -> Generator[None, None, None]:
    """Turn what SQLite can't do into an `InputError`: a full disk, an error of the device, a foreign file."""
    try:
        yield
    except sqlite3.Error as error:
        if "not a database" in str(error):
            message = f"{path}: not a file of records ({error}); use another folder, or move the file away"
        else:
            message = (
                f"{path}: can't be read or written ({error}); what is finished is kept: once that is mended, "
                "run the same command again to continue"
            )
        raise InputError(message) from error


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
        with report_failures(path):
            self.connection = sqlite3.connect(path, isolation_level=None, timeout=30)
            try:
                with self.transaction() as connection:
                    prepare_layout(connection, path)
                self.connection.execute("pragma journal_mode = wal")
                self.connection.execute("pragma synchronous = normal")
            except BaseException:
                self.connection.close()
                raise

    def close(self) -> None:
        """Close the file."""
        self.connection.close()

    @contextmanager
    def transaction(self) -> Generator[sqlite3.Connection, None, None]:
        """Write all that follows, or, after an error, none of it."""
        self.connection.execute("begin immediate")
        try:
            yield self.connection
            self.connection.execute("commit")
        except BaseException:
            if self.connection.in_transaction:  # not where SQLite has rolled back of itself
                self.connection.execute("rollback")
            raise

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
        fields = "dataset, pair, nuisance, level, combination, nms_radius, seed, coalesce(changes, '')"
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
        return count_records(self.connection)

    # --- records ---------------------------------------------------------------------------------

    def content(self, case_key: str) -> bytes:
        """Packed correspondences of a case."""
        query = "select content from arrays where case_key = ?"
        return self.connection.execute(query, (case_key,)).fetchone()[0]

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
