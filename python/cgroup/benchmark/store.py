"""Results in one SQLite file: what has been computed, and what the latest configuration asks for.

Computed rows stay for good, under keys made from what they depend on. The plan, that is which problems,
solvers and thresholds the sets ask for, is replaced by each run; missing results follow from both.
"""

from __future__ import annotations

import itertools
import json
import sqlite3
from contextlib import closing, contextmanager, suppress
from dataclasses import astuple, fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple

from cgroup._runtime.sqlite import Layout, open_or_make
from cgroup.benchmark.problem import Problem
from cgroup.benchmark.solver import Solver
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable, Iterator, Sequence
    from pathlib import Path

    from cgroup.benchmark.plan import Plan, PlannedSet
    from cgroup.benchmark.results import Matched, Result, Score

RECORDS = "records.sqlite"
"""Name of the file in a run's folder."""

_LARGEST_INTEGER = 2**63 - 1

_FIELDS = [field.name for field in fields(Problem)]
_PROBLEM = ", ".join(f"p.{name}" for name in _FIELDS)

_SCHEMA = f"""
create table machines (id text primary key, cpu text, cores integer, system text, python text, numpy text);
create table datasets (name text primary key, title text, role text, origin text, citation text);
create table solvers (key text primary key, name text, options text, refined integer);

-- The last nine columns are of matching it once for all methods; a null in `error`: not yet.
create table problems (
    key text primary key, {", ".join(_FIELDS).replace("level", "level real")}, origin text, protocols text,
    n integer, pr real, facts text, seconds text, parameters text, error text, version text, machine text,
    created text
);
-- Apart, since reading a column behind a large one means reading that too.
create table arrays (problem text primary key references problems, content blob, truth blob, sample blob);
create table results (
    problem text references problems, solver text references solvers, threads integer, only_on text,
    time_limit real, seconds real, mask blob, pose blob, numbers text, skipped text, error text,
    version text, machine text, created text, primary key (problem, solver, threads, only_on)
) without rowid;
create table scores (
    problem text, solver text, epsilon real, correct integer, selected integer, selected_correct integer,
    rotation_error real, translation_error real, rmse real, protocols text,
    primary key (problem, solver, epsilon)
) without rowid;

create table plan (config text, missing text);
create table plan_sets (
    entry integer primary key, task text, id text, definition text, threads text, epsilons text,
    time_limit real
);
create table plan_problems (entry integer, problem text, place integer, primary key (entry, problem));
create table plan_solvers (
    entry integer, solver text, label text, place integer, primary key (entry, solver)
);
create view wanted as
    select problem, solver, t.value as threads, task, min(entry) as entry, min(p.place) as place,
           min(s.place) as solver_place, min(label) as label, max(time_limit) as time_limit
    from plan_sets join plan_problems p using (entry) join plan_solvers s using (entry),
         json_each(plan_sets.threads) t
    group by problem, solver, t.value;
create view wanted_scores as
    select problem, solver, e.value as epsilon, min(label) as label, min(s.place) as place,
           json_group_array(distinct plan_sets.id) as experiments
    from plan_sets join plan_problems p using (entry) join plan_solvers s using (entry),
         json_each(plan_sets.epsilons) e
    group by problem, solver, e.value;
create view wanted_matches as
    select distinct problem, task from plan_sets join plan_problems using (entry)
    where task in ('experiment', 'timing');
"""

RECORDS_LAYOUT = Layout(0x63677270, 1, _SCHEMA)
"""Its `application_id` is "cgrp"."""

# Problems of one pair follow each other, so that a worker loads it once.
_CASE_ORDER = "dataset, pair, nuisance, level, nms_radius, matches"
_ORDERS = {
    "experiment": f"{_CASE_ORDER}, w.problem, w.solver",
    "registration": "dataset, pair, kind, other, w.problem, w.solver",
    "scenes": "w.entry, w.place, w.solver_place",
    "matches": "w.threads, w.entry, w.place, w.problem, w.solver_place",
    "timing": "size, w.solver_place, w.threads desc",
}

_PENDING = f"""
select {_PROBLEM}, w.threads, w.entry, w.time_limit, p.n, w.solver
from wanted w join problems p on p.key = w.problem
where w.task = ? and (w.task <> 'experiment' or p.error = '') and not exists (
    select 1 from results r
    where r.problem = w.problem and r.solver = w.solver and r.threads = w.threads
        -- Solvers that were given up for want of time are tried again once they are given more.
        and (r.skipped = '' or r.time_limit >= w.time_limit))
order by """

_RESULTS = """
select count(r.problem), coalesce(sum(coalesce(r.error, '') <> ''), 0), count(*)
from wanted left join results r using (problem, solver, threads) where wanted.task = """

_COUNTS = {
    "correspond": """
select count(error), coalesce(sum(error <> ''), 0), count(*)
from wanted_matches join problems on key = problem where wanted_matches.task = 'experiment'
""",
    "group": f"{_RESULTS}'experiment'",
    "score": """
select count(s.problem), 0, count(*) from wanted_scores left join scores s using (problem, solver, epsilon)
""",
    "register": f"{_RESULTS}'registration'",
    "place": f"{_RESULTS}'scenes'",
    "try": f"{_RESULTS}'matches'",
}
"""Statement that counts what is done, failed and wanted, by stage."""


class Counts(NamedTuple):
    """Numbers of done, failed and wanted results of one stage."""

    done: int
    failed: int
    wanted: int


class Pending(NamedTuple):
    """A problem that solvers are still to be run on; `entry` numbers the set that wants it.

    `limit` are seconds after which a solver is given up; `n` counts the matches, if they are stored.
    """

    problem: Problem
    threads: int
    entry: int
    limit: float
    n: int | None
    solvers: tuple[Solver, ...] = ()


class DamagedError(Exception):
    """SQLite can't read the file, whose structure isn't what it was."""


@contextmanager
def report_failures(path: Path) -> Generator[None, None, None]:
    """Turn SQLite's errors into `InputError` (full disk, failing device, foreign file) or `DamagedError`."""
    try:
        yield
    except sqlite3.Error as error:
        if "malformed" in str(error):
            raise DamagedError(str(error)) from error
        if "not a database" in str(error):
            message = f"{path}: not a file of records ({error}); use another folder, or move the file away"
        else:
            message = (
                f"{path}: can't be read or written ({error}); what is finished is kept: once that is mended, "
                "run the same command again to continue"
            )
        raise InputError(message) from error


@contextmanager
def only_writer(folder: Path) -> Generator[None, None, None]:
    """Keep other runs off a folder (`InputError`); the lock goes with the process, however it ends."""
    try:
        lock = sqlite3.connect(folder / "lock.sqlite", isolation_level=None, timeout=0)
        try:
            lock.execute("begin exclusive")
        except BaseException:
            lock.close()
            raise
    except sqlite3.Error as error:
        if "locked" in str(error):
            message = f"{folder}: another run is at work there ({error}); wait for it or use another folder"
        else:
            message = f"{folder}: can't be written to ({error}); make room there, or use another folder"
        raise InputError(message) from error
    with closing(lock):
        yield


def foreign_records(path: Path) -> InputError:
    """Return the error for a file of another layout, or none of records."""
    return InputError(
        f"{path}: not a file of records of this version of cgroup; use the version that made it, or another "
        "folder"
    )


def set_aside(path: Path) -> Path:
    """Move a file that can't be read, so that a run can start anew; return its new path."""
    names = (path.with_name(f"{path.stem}.damaged-{number}{path.suffix}") for number in itertools.count(1))
    kept = next(name for name in names if not name.exists())
    try:
        path.replace(kept)
        for suffix in ("-wal", "-shm"):  # they would be taken for those of the new file
            with suppress(FileNotFoundError):
                path.with_name(path.name + suffix).replace(kept.with_name(kept.name + suffix))
    except OSError as error:
        message = f"{path}: damaged, and can't be set aside ({error.strerror or error}); move it away"
        raise InputError(message) from error
    return kept


def count_results(connection: sqlite3.Connection) -> dict[str, Counts]:
    """Count what is done, failed and wanted of each stage."""
    counts: dict[str, Counts] = {}
    for stage, statement in _COUNTS.items():
        done, failed, wanted = connection.execute(statement).fetchone()
        counts[stage] = Counts(done - failed, failed, wanted)
    return counts


class Store:
    """Results of one folder, in a file that is made if need be; one process writes, any number may read."""

    def __init__(self, path: Path) -> None:
        with report_failures(path):
            self.connection = open_or_make(path, RECORDS_LAYOUT, foreign_records(path))

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
        lists = json.dumps(planned.threads), json.dumps(planned.epsilons)
        name = getattr(planned.entry, "id", "")
        definition = planned.entry.model_dump_json()
        self._insert("plan_sets", entry, planned.task, name, definition, *lists, planned.limit)
        for place, problem in enumerate(planned.problems):
            origin, protocols = pairs.get(problem.dataset, {}).get(problem.pair, ("", ()))
            row = (problem.key, *map(_stored, astuple(problem)), origin, json.dumps(protocols))
            self.connection.execute(
                f"insert into problems (key, {', '.join(_FIELDS)}, origin, protocols) values ({_marks(row)}) "
                "on conflict (key) do update set origin = excluded.origin, protocols = excluded.protocols",
                row,
            )
            self._insert("plan_problems", entry, problem.key, place)
        for place, solver in enumerate(planned.solvers):
            self._insert("solvers", solver.key, solver.name, solver.options, solver.refined, known="ignore")
            self._insert("plan_solvers", entry, solver.key, solver.label, place, known="ignore")

    def forget_failures(self) -> None:
        """Drop what failed, so that it is tried again."""
        with self.transaction():
            self.connection.execute("delete from results where error <> ''")
            self.connection.execute("update problems set error = null where error <> ''")

    def forget_matches(self, problem: str) -> None:
        """Drop all that was made from the matches of a problem, so that it is computed anew."""
        with self.transaction():
            for table in ("arrays", "results", "scores"):
                self.connection.execute(f"delete from {table} where problem = ?", (problem,))
            self.connection.execute("update problems set error = null where key = ?", (problem,))

    # --- what is missing -------------------------------------------------------------------------

    def unmatched(self, at_most: int) -> list[tuple[Problem, ...]]:
        """Problems of experiments to be matched, in parts of the same pair that are not too large."""
        rows = self.connection.execute(
            f"select {_PROBLEM} from wanted_matches w join problems p on p.key = w.problem "
            f"where p.error is null and w.task = 'experiment' order by {_CASE_ORDER}"
        )
        parts: list[tuple[Problem, ...]] = []
        for _, same_pair in itertools.groupby(map(_problem, rows), lambda p: (p.dataset, p.pair)):
            problems = iter(same_pair)
            while part := tuple(itertools.islice(problems, at_most)):
                parts.append(part)
        return parts

    def pending(self, task: str) -> list[Pending]:
        """Problems of a task whose matches are there, with the solvers that lack a result."""
        kept = self.connection.execute("select key, name, options, refined from solvers")
        solvers = {
            key: Solver(name, name, options, None if refined is None else bool(refined))
            for key, name, options, refined in kept
        }
        rows = self.connection.execute(_PENDING + _ORDERS[task], (task,))
        found: dict[Pending, list[Solver]] = {}
        for *problem, threads, entry, limit, n, key in rows:
            by = Pending(_problem(problem), threads, 0 if task == "experiment" else entry, limit, n)
            found.setdefault(by, []).append(solvers[key])
        return [each._replace(solvers=tuple(missing)) for each, missing in found.items()]

    def unscored(self) -> dict[str, dict[str, list[float]]]:
        """Thresholds at which groups are to be scored, by problem and solver."""
        query = """
        select w.problem, w.solver, w.epsilon from wanted_scores w
            join results r on r.problem = w.problem and r.solver = w.solver and r.error = ''
        where not exists (
            select 1 from scores s
            where s.problem = w.problem and s.solver = w.solver and s.epsilon = w.epsilon)
        """
        found: dict[str, dict[str, list[float]]] = {}
        for problem, solver, epsilon in self.connection.execute(query):
            found.setdefault(problem, {}).setdefault(solver, []).append(epsilon)
        return found

    def counts(self) -> dict[str, Counts]:
        """How far the stages are with the plan."""
        return count_results(self.connection)

    # --- results ---------------------------------------------------------------------------------

    def content(self, problem: str) -> bytes | None:
        """Packed matches of a problem; None before it is matched."""
        row = self.connection.execute("select content from arrays where problem = ?", (problem,)).fetchone()
        return None if row is None else row[0]

    def truth(self, problem: str) -> tuple[bytes, bytes, bytes, tuple[str, ...]]:
        """Packed matches, true pose and overlap sample of a problem (empty if lost), and its protocols."""
        query = """
        select coalesce(content, ''), truth, sample, protocols
        from problems left join arrays on problem = key where key = ?
        """
        content, truth, sample, protocols = self.connection.execute(query, (problem,)).fetchone()
        return content, truth, sample, tuple(json.loads(protocols))

    def groups(self, problem: str) -> Iterator[tuple[str, bytes, bytes | None]]:
        """Read solver, mask and pose of every group of a problem that went well."""
        query = "select solver, mask, pose from results where problem = ? and error = '' and mask is not null"
        yield from self.connection.execute(query, (problem,))

    def times(self, problem: str, solver: str, threads: int, machine: str) -> list[float]:
        """Read the seconds of a solver in the timing on a machine; none if they weren't taken."""
        query = """
        select numbers from results
        where problem = ? and solver = ? and threads = ? and only_on = ? and skipped = ''
        """
        row = self.connection.execute(query, (problem, solver, threads, machine)).fetchone()
        return [] if row is None else json.loads(row[0])["repeats"]

    def add_matched(self, records: Iterable[Matched]) -> None:
        """Store matched problems, all or none."""
        known = "n, pr, facts, seconds, parameters, error, version, machine, created"
        with self.transaction():
            for each in records:
                problem, content, truth, sample, *row = self._row(each)
                update = f"update problems set ({known}) = ({_marks(row)}) where key = ?"
                self.connection.execute(update, (*row, problem))
                if not each.error:
                    self._insert("arrays", problem, content, truth, sample, known="replace")

    def add_results(self, results: Iterable[Result]) -> None:
        """Store results, all or none, in place of those of solvers that were given up."""
        with self.transaction():
            for each in results:
                self._insert("results", *self._row(each), known="replace")

    def add_scores(self, scores: Sequence[Score]) -> None:
        """Store scores, all or none."""
        with self.transaction():
            for each in scores:
                self._insert("scores", *astuple(each))

    def _row(self, record: Matched | Result) -> list[Any]:
        """Store the machine unless it is there; return all fields, the last of them its id and the time."""
        *row, provenance = vars(record).values()
        machine = provenance.machine
        self._insert("machines", machine.id, *astuple(machine), known="ignore")
        return [*row, provenance.version, machine.id, provenance.created]

    def _insert(self, table: str, *row: object, known: str = "abort") -> None:
        """Add a row; `known` says what to do where its key is taken: abort, ignore or replace."""
        self.connection.execute(f"insert or {known} into {table} values ({_marks(row)})", row)


def _stored(value: Any) -> Any:  # noqa: ANN401 - of any field
    """Return a value as SQLite keeps it, whose integers end before seeds do: larger ones become text."""
    return str(value) if isinstance(value, int) and value > _LARGEST_INTEGER else value


def _problem(row: Sequence[Any]) -> Problem:
    problem = Problem(*row)
    return replace(problem, seed=int(problem.seed))


def _marks(row: Sequence[object]) -> str:
    return ", ".join("?" * len(row))
