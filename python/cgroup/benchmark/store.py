"""Results of a folder in one SQLite file, and the plan of the latest configuration.

Results are kept under keys made from the problem and the solver. Each run replaces the plan: which problems,
solvers and thresholds its sets ask for. Missing results follow from both.
"""

import json
import os
import sqlite3
from collections.abc import Generator, Iterable
from contextlib import closing, contextmanager
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any, NamedTuple

from cgroup._checks.values import as_path
from cgroup._runtime.sqlite import Layout, is_empty, open_or_make
from cgroup._runtime.toml import read_packaged
from cgroup.benchmark.plan import Plan, PlannedSet
from cgroup.benchmark.problem import Problem, Task
from cgroup.benchmark.results import Matched, Pending, Result, pack
from cgroup.benchmark.solver import Solver
from cgroup.errors import InputError

RECORDS = "records.sqlite"  # name of the file in a run's folder
_LARGEST_INTEGER = 2**63 - 1

# Its `application_id` is "cgrp".
RECORDS_LAYOUT = Layout(0x63677270, 1, read_packaged("cgroup.benchmark", "sql/schema.sql"))


class Counts(NamedTuple):
    """Numbers of done, failed and wanted results of one kind."""

    done: int
    failed: int
    wanted: int


@contextmanager
def report_failures(path: Path) -> Generator[None, None, None]:
    """Turn SQLite's errors into `InputError`: full disk, failing device, damaged or foreign file."""
    try:
        yield
    except sqlite3.Error as error:
        if "malformed" in str(error) or "not a database" in str(error):
            message = (
                f"{path}: damaged, or not a file of records ({error}); move it away, or use another folder"
            )
        else:
            message = (
                f"{path}: can't be read or written ({error}); finished results are kept: fix this, then run "
                "the same command again"
            )
        raise InputError(message) from error


@contextmanager
def only_writer(folder: Path) -> Generator[None, None, None]:
    """Lock a folder against other runs (`InputError`); the lock ends with the process."""
    try:
        lock = sqlite3.connect(folder / "lock.sqlite", isolation_level=None, timeout=0)
        try:
            lock.execute("begin exclusive")
        except BaseException:
            lock.close()
            raise
    except sqlite3.Error as error:
        if "locked" in str(error):
            message = f"{folder}: another run is using it ({error}); wait for it or use another folder"
        else:
            message = f"{folder}: can't be written to ({error}); free space there, or use another folder"
        raise InputError(message) from error
    with closing(lock):
        yield


def foreign_records(path: Path) -> InputError:
    """Return the error for a file of another layout, or of another program."""
    return InputError(
        f"{path}: not a file of records of this version of cgroup; use the version that made it, or another "
        "folder"
    )


@contextmanager
def open_records(path: Path | str) -> Generator[sqlite3.Connection, None, None]:
    """Open the results for reading; a run may write at the same time."""
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
        raise InputError(
            f"{file}: not a file of records, or one that can't be read ({error}); the next run computes all "
            "results again"
        ) from error


def _absent(path: Path) -> InputError:
    file = path / RECORDS if path.is_dir() else path
    return InputError(f"{file}: no records; make some with: cgroup benchmark run smoke --out {path}")


def read_plan(path: Path, column: str) -> Any:  # noqa: ANN401 - any JSON
    """Return a column of the plan."""
    with open_records(path) as connection:
        row = connection.execute(f"select {column} from plan").fetchone()
    if row is None:
        raise _absent(path)
    return json.loads(row[0])


def count_results(connection: sqlite3.Connection) -> dict[str, Counts]:
    """Count done, failed and wanted results of each kind in the plan."""
    rows = connection.execute(read_packaged("cgroup.benchmark", "sql/counts.sql")).fetchall()
    return {task: Counts(done - failed, failed, wanted) for task, done, failed, wanted in rows}


class Store:
    """Results of one folder; one process writes, any number may read."""

    def __init__(self, path: Path) -> None:
        with report_failures(path):
            self.connection = open_or_make(path, RECORDS_LAYOUT, foreign_records(path))

    def close(self) -> None:
        """Close the file."""
        self.connection.close()

    @contextmanager
    def transaction(self) -> Generator[None, None, None]:
        """Write all changes of the block, or none after an error."""
        self.connection.execute("begin immediate")
        try:
            yield
            self.connection.execute("commit")
        except BaseException:
            if self.connection.in_transaction:  # false if SQLite has rolled back itself
                self.connection.execute("rollback")
            raise

    def replace_plan(self, plan: Plan) -> None:
        """Replace the stored plan."""
        with self.transaction():
            for table in ("plan", "plan_sets", "plan_problems", "plan_solvers"):
                self.connection.execute(f"delete from {table}")
            self._insert("plan", plan.config.model_dump_json(), json.dumps(plan.missing))
            for facts in plan.datasets:
                row = (facts.name, facts.title, facts.role, facts.origin, facts.citation)
                self._insert("datasets", *row, known="replace")
            pairs = {facts.name: facts.pairs for facts in plan.datasets}
            for entry, planned in enumerate(plan.sets):
                self._insert_set(entry, planned, pairs)

    def _insert_set(
        self, entry: int, planned: PlannedSet, pairs: dict[str, dict[str, tuple[str, tuple[str, ...]]]]
    ) -> None:
        made_by = planned.entry
        row = (made_by.task, getattr(made_by, "id", ""), made_by.model_dump_json())
        lists = json.dumps(planned.threads), json.dumps(planned.epsilons)
        self._insert("plan_sets", entry, *row, *lists, planned.limit)
        for place, problem in enumerate(planned.problems):
            origin, protocols = pairs.get(problem.dataset, {}).get(problem.pair, ("", ()))
            values = (problem.key, *map(_stored, astuple(problem)), origin, json.dumps(protocols))
            self._insert("problems", *values, known="replace")
            self._insert("plan_problems", entry, problem.key, place)
        for place, solver in enumerate(planned.solvers):
            self._insert("solvers", solver.key, solver.name, solver.options, solver.refined, known="ignore")
            self._insert("plan_solvers", entry, solver.key, solver.label, place, known="ignore")

    def forget_failures(self) -> None:
        """Delete results with an error, and the matches of their problems."""
        with self.transaction():
            failed = "select problem from results where error <> ''"
            self.connection.execute(f"delete from matches where problem in ({failed})")
            self.connection.execute("delete from results where error <> ''")

    def pending(self, task: Task) -> list[Pending]:
        """Return the problems of a kind with the solvers without a result, in the order of the work."""
        kept = self.connection.execute("select key, name, options, refined from solvers")
        solvers = {
            key: Solver(name, name, options, None if refined is None else bool(refined))
            for key, name, options, refined in kept
        }
        found: dict[Pending, list[Solver]] = {}
        rows = self.connection.execute(read_packaged("cgroup.benchmark", "sql/pending.sql"), (task,))
        for *values, threads, entry, limit, wanted, known, key in rows:
            epsilons = {each for each in (*json.loads(wanted), *json.loads(known)) if each is not None}
            problem = Problem(*values)
            problem = replace(problem, seed=int(problem.seed))
            # Solvers of a problem are run together, for all experiments with this problem.
            of = 0 if task == "experiment" else entry
            pending = Pending(problem, (), threads, tuple(sorted(epsilons)), limit, of)
            found.setdefault(pending, []).append(solvers[key])
        return [replace(each, solvers=tuple(missing)) for each, missing in found.items()]

    def matched(self) -> dict[str, int]:
        """Return the numbers of matches of the problems whose matches are stored."""
        return dict(self.connection.execute("select problem, n from matches"))

    def content(self, problem: str) -> bytes:
        """Return the packed matches of a problem."""
        query = "select content from matches where problem = ?"
        return self.connection.execute(query, (problem,)).fetchone()[0]

    def add_matched(self, records: Iterable[tuple[str, Matched]]) -> None:
        """Store the matches of problems, all or none."""
        with self.transaction():
            for problem, each in records:
                row = (problem, len(each.matches), pack(each))
                self._insert("matches (problem, n, content)", *row, known="replace")

    def add_results(self, results: Iterable[Result]) -> None:
        """Store results, all or none, in place of earlier ones."""
        with self.transaction():
            for each in results:
                *row, version, machine, created = vars(each).values()
                self._insert("machines", machine.id, *astuple(machine), known="ignore")
                self._insert("results", *row, version, machine.id, created, known="replace")

    def _insert(self, table: str, *row: object, known: str = "abort") -> None:
        """Add a row; `known` is the action for a key that exists: abort, ignore or replace."""
        marks = ", ".join("?" * len(row))
        self.connection.execute(f"insert or {known} into {table} values ({marks})", row)


def _stored(value: Any) -> Any:  # noqa: ANN401 - of any field
    """Return integers beyond SQLite's range as text, and other values unchanged."""
    return str(value) if isinstance(value, int) and value > _LARGEST_INTEGER else value
