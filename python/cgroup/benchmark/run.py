"""Running a configuration: whatever lacks a result is computed, so that a stopped run continues.

Problems of experiments are matched and grouped by many workers, then scored. The timing, the comparisons of
ways to register and that of methods on matches follow, with nothing else at work.
"""

from __future__ import annotations

import itertools
import json
from collections import defaultdict, deque
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from operator import attrgetter
from typing import TYPE_CHECKING

from cgroup._checks.values import as_count, as_path
from cgroup._runtime.progress import ignore_progress
from cgroup.benchmark import solving
from cgroup.benchmark.engine import OutOfTimeError, ProcessDiedError, Worker, WorkerError, open_workers
from cgroup.benchmark.matching import PreparedMatches, forget_pairs, match_problems, try_to_prepare
from cgroup.benchmark.plan import make_plan
from cgroup.benchmark.results import KILLED, OUT_OF_TIME, Matched, Result
from cgroup.benchmark.store import RECORDS, DamagedError, Store, only_writer, report_failures, set_aside
from cgroup.benchmark.timing import take_times
from cgroup.benchmark.worker import ALL_CORES
from cgroup.io._results import make_folder

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from pathlib import Path
    from typing import Any, TypeAlias

    from cgroup.benchmark.config import Config
    from cgroup.benchmark.engine import CallUnordered
    from cgroup.benchmark.plan import Plan
    from cgroup.benchmark.solver import Solver
    from cgroup.benchmark.store import Counts, Pending

    Progress: TypeAlias = Callable[[str, int, int], Any]

__all__ = ["Summary", "run"]

GIVEN_UP = 2
"""Calls of a method that ran out of time; on problems of no fewer matches it isn't tried again."""

# Of one pair to a worker, which then loads it once; they are lost if the run is killed meanwhile.
_PROBLEMS_AT_ONCE = 4


@dataclass(frozen=True)
class Summary:
    """The outcome of a run.

    Attributes
    ----------
    counts : dict of str to Counts
        Done, failed and wanted results of each stage: "correspond", "group", "score", "register", "place",
        "try".
    missing : dict of str to str
        Data sets and pipelines that are not at hand, and why.
    damaged : str
        The reason why the results of earlier runs couldn't be read, and their new place; empty where they
        could. All is computed anew then.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gc", "gtm"], experiment=[small])
    >>> summary = run(config, Path("results"), backend="threading")
    >>> summary.counts["group"], summary.missing
    (Counts(done=4, failed=0, wanted=4), {})
    """

    counts: dict[str, Counts]
    missing: dict[str, str]
    damaged: str = ""

    @property
    def failed(self) -> int:
        """Number of pairs that couldn't be matched, and of solvers that went wrong.

        Examples
        --------
        >>> from cgroup.benchmark.run import Summary
        >>> Summary(counts={}, missing={}).failed
        0
        """
        return sum(count.failed for count in self.counts.values())


def run(
    config: Config,
    out: Path | str,
    *,
    root: Path | str | None = None,
    backend: str = "processes",
    workers: int | None = None,
    scheduler: str | None = None,
    retry_failed: bool = False,
    progress: Progress | None = None,
) -> Summary:
    """Compute every result that a configuration asks for and the folder lacks.

    The results do not depend on backend or workers. Stopped at any moment, by a signal or for good, it
    loses only what was under way; called again, it continues. A file that SQLite can't read is set aside, and
    all is computed anew.

    Parameters
    ----------
    config : Config
        What to run.
    out : path
        Folder of the results; made if need be.
    root : path, optional
        Folder with the data, at the same place on every machine; the environment says by default.
    backend : str
        "processes" of this machine, "dask" (a cluster) or "threading".
    workers : int, optional
        How many; one per core by default. A cluster's own number counts with "dask".
    scheduler : str, optional
        Address of the Dask scheduler; ``DASK_SCHEDULER_ADDRESS`` by default.
    retry_failed : bool
        Try again what failed.
    progress : callable, optional
        Called with the stage and how many of how many results are there, as they come in.

    Returns
    -------
    Summary
        Failures are counted there, and don't stop the rest.

    Raises
    ------
    InputError
        If no data set is at hand, the backend isn't or is unknown, `workers` is not at least 1, another run
        uses the folder, or the results can't be read or written: the disk is full, say. What is finished is
        kept then.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> from cgroup.benchmark.tables import load
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gc", "gtm"], experiment=[small])
    >>> run(config, Path("results"), backend="threading").failed
    0
    >>> len(load(Path("results")))  # two methods on two pairs
    4
    """
    if workers is not None:
        as_count("workers", workers, 1)
    out, root = as_path("out", out), None if root is None else as_path("root", root)
    forget_pairs()
    plan = make_plan(config, root)
    make_folder(out)
    folder = None if root is None else str(root)

    def compute() -> Summary:
        with report_failures(out / RECORDS), closing(Store(out / RECORDS)) as store:
            store.replace_plan(plan)
            if retry_failed:
                store.forget_failures()
            runner = _Runner(store, folder, progress or ignore_progress)
            with open_workers(backend, workers, scheduler) as call_unordered:
                runner.run_experiments(call_unordered)
            runner.run_alone(plan)
            return Summary(store.counts(), plan.missing)

    with only_writer(out):
        try:
            return compute()
        except DamagedError as error:
            kept = set_aside(out / RECORDS)
            return replace(compute(), damaged=f"{out / RECORDS}: {error}; all as it was is in {kept}")


class _Runner:
    """Computes the results that a store lacks."""

    def __init__(self, store: Store, root: str | None, progress: Progress) -> None:
        self._store = store
        self._root = root
        self._progress = progress
        self._stage, self._done, self._wanted = "", 0, 0

    def _begin(self, stage: str) -> None:
        counts = self._store.counts()[stage]
        self._stage, self._done, self._wanted = stage, counts.done + counts.failed, counts.wanted
        self._tell(0)

    def _tell(self, results: int) -> None:
        """Pass on how far the stage is, with what earlier runs have done."""
        self._done += results
        self._progress(self._stage, self._done, self._wanted)

    def _add(self, results: list[Result]) -> None:
        self._store.add_results(results)
        self._tell(len(results))

    # --- experiments -----------------------------------------------------------------------------

    def run_experiments(self, call_unordered: CallUnordered) -> None:
        """Match, group and score; once more for problems whose stored matches can't be read."""
        for _ in range(2):
            self._match(call_unordered)
            unreadable = self._group(call_unordered) + self._score()
            for problem in unreadable:
                self._store.forget_matches(problem)
            if not unreadable:
                break

    def _match(self, call_unordered: CallUnordered) -> None:
        tasks = [(problems, self._root) for problems in self._store.unmatched(_PROBLEMS_AT_ONCE)]
        self._begin("correspond")
        for (problems, _), records in call_unordered(match_problems, tasks, None) if tasks else ():
            if isinstance(records, WorkerError):
                records = [Matched(problem.key, error=KILLED) for problem in problems]  # noqa: PLW2901
            self._store.add_matched(records)
            self._tell(len(records))

    def _group(self, call_unordered: CallUnordered) -> list[str]:
        """Group all matches but those that can't be read, which are returned."""
        unreadable: list[str] = []
        slow: defaultdict[str, list[int]] = defaultdict(list)
        self._begin("group")
        pending = sorted(self._store.pending("experiment"), key=attrgetter("limit"))
        for limit, cases in itertools.groupby(pending, key=attrgetter("limit")):
            waiting = deque(cases)
            while waiting:  # cases that were put back at the very end
                unreadable += self._group_within(limit, waiting, call_unordered, slow)
        return unreadable

    def _group_within(
        self,
        limit: float,
        waiting: deque[Pending],
        call_unordered: CallUnordered,
        slow: defaultdict[str, list[int]],
    ) -> Iterator[str]:
        """Group by all methods of a case together, within so many seconds; where that fails, by each alone.

        Yield problems that can't be read. `slow` has numbers of matches on which methods ran out of time.
        """
        cases: dict[str, Pending] = {}

        def tasks() -> Iterator[tuple[object, ...]]:
            # Drawn one by one: all the correspondences together may not fit into memory.
            while waiting:
                case = waiting.popleft()
                key = case.problem.key
                cases[key] = case
                if methods := self._drop_slow(case, slow):
                    yield key, case.problem.seed, self._store.content(key), methods

        for (key, *_, methods), grouped in call_unordered(solving.group_problem, tasks(), limit):
            if not isinstance(grouped, WorkerError):
                if not grouped:
                    yield key
                self._add(grouped)
            elif len(methods) > 1:  # one of them did it; each alone shows which
                waiting.extendleft(cases[key]._replace(solvers=(method,)) for method in methods)
            else:
                if isinstance(grouped, OutOfTimeError):
                    slow[methods[0].key].append(cases[key].n or 0)
                self._add([Result(key, methods[0].key, error=_describe(grouped, limit))])

    def _drop_slow(self, case: Pending, slow: defaultdict[str, list[int]]) -> list[Solver]:
        """Return methods of a case without those that are given up, which is recorded."""
        left: list[Solver] = []
        for method in case.solvers:
            if why := _why_not_run(slow[method.key], case.n or 0, case.limit):
                self._add([Result(case.problem.key, method.key, error=f"{OUT_OF_TIME}: {why}")])
            else:
                left.append(method)
        return left

    def _score(self) -> list[str]:
        """Score all groups but those of problems that can't be read, which are returned."""
        unscored = self._store.unscored()
        unreadable: list[str] = []
        self._begin("score")
        for key, wanted in unscored.items():
            truth = solving.unpack_truth(key, *self._store.truth(key))
            if truth is None:
                unreadable.append(key)
                continue
            scores = [
                score
                for solver, mask, pose in self._store.groups(key)
                if solver in wanted
                for score in solving.score_grouping(truth, solver, mask, pose, wanted[solver])
            ]
            self._store.add_scores(scores)
            self._tell(len(scores))
        return unreadable

    # --- with nothing else at work ---------------------------------------------------------------

    def run_alone(self, plan: Plan) -> None:
        """Take times, compare ways to register, and methods on matches."""
        config = plan.config
        for planned in plan.sets:
            if planned.task == "timing" and config.timing is not None:
                take_times(planned, config.timing, self._store, self._root, self._progress)
        if config.registration is not None:
            self._begin("register")
            self._work_through("registration", self._register)
        if config.scenes is not None:
            self._begin("place")
            self._work_through("scenes", self._place)
        if config.trials is not None:
            self._begin("try")
            with closing(Worker(ALL_CORES)) as maker:
                given_up: dict[tuple[int, int, str], list[int]] = {}
                self._work_through("matches", lambda each, worker: self._try(each, worker, maker, given_up))

    def _work_through(self, task: str, work: Callable[[Pending, Worker], Iterable[Result]]) -> None:
        """Work through problems in one other process, which may die of a solver.

        The process is told to compute on as many threads as the problems ask for, before any library loads.
        """
        pending = sorted(self._store.pending(task), key=lambda each: each.threads)
        for threads, problems in itertools.groupby(pending, key=lambda each: each.threads):
            with closing(Worker(threads, cores=threads)) as worker:
                for each in problems:
                    for result in work(each, worker):
                        self._add([result])

    def _register(self, pending: Pending, worker: Worker) -> list[Result]:
        """Register by all solvers that lack a result."""
        problem, threads, solvers = pending.problem, pending.threads, pending.solvers
        work = solving.register, problem, threads, solvers, self._root
        try:
            return worker.call(*work, limit=pending.limit)
        except WorkerError as error:
            if len(solvers) == 1:
                why = _describe(error, pending.limit)
                return [Result(problem.key, solvers[0].key, threads, error=why)]
        # One of them did it; each alone shows which.
        return list(self._place(pending, worker))

    def _place(self, pending: Pending, worker: Worker) -> Iterator[Result]:
        """Register by each solver alone, which may take minutes: what is done before a stop is kept."""
        for each in pending.solvers:
            yield from self._register(pending._replace(solvers=(each,)), worker)

    def _try(
        self,
        pending: Pending,
        worker: Worker,
        maker: Worker,
        given_up: dict[tuple[int, int, str], list[int]],
    ) -> Iterator[Result]:
        """Run methods alone on matches, made in the process of `maker`: the worker holds nothing else."""
        try:
            problem = maker.call(try_to_prepare, pending.problem, self._root)
        except ProcessDiedError:
            problem = KILLED
        for method in pending.solvers:
            slow = given_up.setdefault((pending.threads, pending.entry, method.key), [])
            yield _try_method(pending, problem, method, worker, slow)


def _why_not_run(slow: list[int], n: int, limit: float) -> str:
    """Say why a method isn't tried on n matches, if it isn't; on those of `slow` it ran out of time."""
    if sum(fewer <= n for fewer in slow) < GIVEN_UP:
        return ""
    return f"not run: took longer than {limit:g} s on {min(slow):,} matches"


def _describe(error: WorkerError, limit: float) -> str:
    if isinstance(error, OutOfTimeError):
        return f"{OUT_OF_TIME}: took longer than {limit:g} s"
    return KILLED


def _try_method(
    pending: Pending, problem: PreparedMatches | str, method: Solver, worker: Worker, slow: list[int]
) -> Result:
    """Run a method, or say why not; `slow` has the numbers of matches on which it ran out of time."""
    limit, seed, threads = pending.limit, pending.problem.seed, pending.threads
    result = partial(Result, pending.problem.key, method.key, threads, limit=limit)
    if isinstance(problem, str):
        return result(error=problem)
    known = solving.describe_matches(problem)
    n, result = known["n"], partial(result, numbers=json.dumps(known))
    if why := _why_not_run(slow, n, limit):
        return result(skipped=why)
    try:
        return worker.call(solving.try_method, result, method, seed, threads, problem, limit=limit)
    except OutOfTimeError:
        slow.append(n)
        return result(skipped=f"took longer than {limit:g} s")
    except ProcessDiedError:
        return result(error=KILLED)
