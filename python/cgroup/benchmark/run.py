"""Run a configuration: compute the missing results of a folder, so that a stopped run can continue."""

import itertools
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from cgroup._checks.values import as_count, as_path
from cgroup._runtime.progress import ignore_progress
from cgroup.benchmark import engine, solving
from cgroup.benchmark.config import Config
from cgroup.benchmark.matching import forget_pairs, match_problem, match_problems
from cgroup.benchmark.plan import make_plan
from cgroup.benchmark.problem import Task
from cgroup.benchmark.results import KILLED, OUT_OF_TIME, Matched, Pending, Result
from cgroup.benchmark.solver import Solver
from cgroup.benchmark.store import RECORDS, Counts, Store, count_results, only_writer, report_failures
from cgroup.io.result_folders import make_folder

Progress: TypeAlias = Callable[[str, int, int], Any]
# Numbers of matches on which a method ran out of time, by method and set
Slow: TypeAlias = defaultdict[tuple[object, ...], list[int]]
__all__ = ["run"]

GIVEN_UP = 2  # calls of a method that ran out of time, after which it isn't run on as many matches or more
# Expected growth of the seconds with n in the timing, while only one size has been timed
UNKNOWN_EXPONENT = 2.0
# Of one pair to a worker, which then loads it once; they are lost if the run is killed meanwhile.
_PROBLEMS_AT_ONCE = 4


@dataclass(frozen=True)
class Summary:
    """Counts of the results of each kind, and the reasons why data sets and pipelines are missing."""

    counts: dict[str, Counts]
    missing: dict[str, str]

    @property
    def failed(self) -> int:
        """Number of failed results."""
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
    """Compute the results of a configuration that are missing in a folder.

    The results do not depend on backend or workers. A stopped run loses only the calls in progress; called
    again, it continues.

    Parameters
    ----------
    config : Config
        Configuration of the run.
    out : path
        Folder of the results; made if need be.
    root : path, optional
        Folder with the data, the same on every machine; ``CGROUP_DATA`` by default.
    backend : str
        "processes" of this machine, "dask" (a cluster) or "threading".
    workers : int, optional
        Number of workers; one per core by default. With "dask" the cluster has its own.
    scheduler : str, optional
        Address of the Dask scheduler; ``DASK_SCHEDULER_ADDRESS`` by default.
    retry_failed : bool
        Run failed problems again.
    progress : callable, optional
        Called with the kind of results, and the numbers of finished and of wanted ones.

    Returns
    -------
    Summary
        `counts` of done, failed and wanted results by kind, the number `failed`, and `missing`: data sets and
        pipelines with the reasons. Failures don't stop the run.

    Examples
    --------
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> from cgroup.benchmark.tables import load
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gc", "gtm"], experiment=[small])
    >>> run(config, "results", backend="threading").failed
    0
    >>> len(load("results"))  # two methods on two pairs
    4
    """
    if workers is not None:
        as_count("workers", workers, 1)
    out, root = as_path("out", out), None if root is None else as_path("root", root)
    forget_pairs()
    plan = make_plan(config, root)
    make_folder(out)

    with only_writer(out), report_failures(out / RECORDS), closing(Store(out / RECORDS)) as store:
        store.replace_plan(plan)
        if retry_failed:
            store.forget_failures()
        runner = _Runner(store, None if root is None else str(root), progress or ignore_progress)
        with engine.open_workers(backend, workers, scheduler) as call_unordered:
            runner.match(call_unordered)
            runner.group(call_unordered)
        for task in ("timing", "registration", "scenes", "matches"):
            runner.run_alone(task)
        return Summary(count_results(store.connection), plan.missing)


class _Runner:
    def __init__(self, store: Store, root: str | None, progress: Progress) -> None:
        self._store = store
        self._root = root
        self._progress = progress
        self._stage, self._done, self._wanted = "", 0, 0

    def _begin(self, stage: str, done: int, wanted: int) -> None:
        self._stage, self._done, self._wanted = stage, done, wanted
        self._report(0)

    def _begin_task(self, task: Task) -> list[Pending]:
        """Return the problems of a kind that lack results; report earlier results as done."""
        counts = count_results(self._store.connection).get(task, Counts(0, 0, 0))
        if counts.wanted:
            self._begin(task, counts.done + counts.failed, counts.wanted)
        return self._store.pending(task)

    def _report(self, results: int) -> None:
        self._done += results
        self._progress(self._stage, self._done, self._wanted)

    def _add(self, results: list[Result]) -> None:
        self._store.add_results(results)
        self._report(len(results))

    def match(self, call_unordered: engine.CallUnordered) -> None:
        """Match the problems of experiments that lack results; errors become results of all solvers."""
        stored = self._store.matched()
        pending = [each for each in self._store.pending("experiment") if each.problem.key not in stored]
        by_problem: dict[str, list[Pending]] = {}
        for each in pending:
            by_problem.setdefault(each.problem.key, []).append(each)
        if by_problem:
            self._begin("match", 0, len(by_problem))
        problems = dict.fromkeys(each.problem for each in pending)
        tasks: list[tuple[object, ...]] = []
        for _, same_pair in itertools.groupby(problems, lambda each: (each.dataset, each.pair)):
            while part := list(itertools.islice(same_pair, _PROBLEMS_AT_ONCE)):
                tasks.append((part, self._root))
        for (part, _), records in call_unordered(match_problems, tasks, None) if tasks else ():
            found = [KILLED] * len(part) if isinstance(records, engine.WorkerError) else records
            known = dict(zip((each.key for each in part), found, strict=True))
            self._store.add_matched((key, each) for key, each in known.items() if isinstance(each, Matched))
            for key, error in known.items():
                if isinstance(error, str):
                    failed = (result for each in by_problem[key] for result in each.fail(error))
                    self._store.add_results(failed)
            self._report(len(part))

    def group(self, call_unordered: engine.CallUnordered) -> None:
        """Group the matches of experiments; methods that exceed the limits of their sets are dropped."""
        slow: Slow = defaultdict(list)
        pending = sorted(self._begin_task("experiment"), key=lambda each: each.limit)
        sizes = self._store.matched()
        for limit, cases in itertools.groupby(pending, key=lambda each: each.limit):
            waiting = deque(cases)
            while waiting:  # cases that were put back at the very end
                self._group_within(limit, waiting, call_unordered, slow, sizes)

    def _group_within(
        self,
        limit: float,
        waiting: deque[Pending],
        call_unordered: engine.CallUnordered,
        slow: Slow,
        sizes: dict[str, int],
    ) -> None:
        """Group by all methods of a problem together, or by each alone after a failure."""

        def tasks() -> Iterator[tuple[object, ...]]:
            # One by one: all matches together may not fit into memory.
            while waiting:
                case = waiting.popleft()
                if left := self._drop_slow(case, slow, sizes[case.problem.key]):
                    content = self._store.content(case.problem.key)
                    yield replace(case, solvers=left), content, self._root

        for (case, *_), results in call_unordered(solving.solve, tasks(), limit):
            if not isinstance(results, engine.WorkerError):
                self._add(results)
            elif len(case.solvers) > 1:  # one of them failed; each alone shows which
                waiting.extendleft(replace(case, solvers=(each,)) for each in case.solvers)
            else:
                if isinstance(results, engine.OutOfTimeError):
                    slow[case.solvers[0].key,].append(sizes[case.problem.key])
                self._add(case.fail(_describe(results, limit)))

    def _drop_slow(self, case: Pending, slow: Slow, n: int) -> tuple[Solver, ...]:
        """Return the methods of a problem without slow ones, whose results are stored."""
        reasons = {each: _why_not_run(slow[each.key,], n, case.limit) for each in case.solvers}
        dropped = [case.result(each, error=f"{OUT_OF_TIME}: {why}") for each, why in reasons.items() if why]
        if dropped:
            self._add(dropped)
        return tuple(each for each, why in reasons.items() if not why)

    def run_alone(self, task: Task) -> None:
        """Run solvers one at a time in a separate process, which a solver may end.

        The number of threads is set in the process before libraries are loaded. Matches are made in another
        process, so that the memory of the first is that of the solver.
        """
        slow: Slow = defaultdict(list)
        times: dict[tuple[str, int], list[tuple[int, float]]] = defaultdict(list)
        by_threads = itertools.groupby(self._begin_task(task), lambda each: each.threads)
        with closing(engine.Worker(engine.ALL_CORES)) as maker:
            for threads, problems in by_threads:
                with closing(engine.Worker(threads, cores=threads)) as worker:
                    for pending in problems:
                        matched = self._match_alone(pending, maker)
                        for each in pending.solvers:
                            known = slow[each.key, threads, pending.entry], times[each.key, threads]
                            one = replace(pending, solvers=(each,))
                            self._add(self._solve_alone(one, matched, worker, *known))

    def _match_alone(self, pending: Pending, maker: engine.Worker) -> Matched | str | None:
        if pending.problem.task in {"registration", "scenes"}:
            return None
        try:
            return maker.call(match_problem, pending.problem, self._root)
        except engine.WorkerError:
            return KILLED

    def _solve_alone(
        self,
        pending: Pending,
        matched: Matched | str | None,
        worker: engine.Worker,
        slow: list[int],
        times: list[tuple[int, float]],
    ) -> list[Result]:
        """Run one solver, or return the reason why it is not run.

        `slow` has the numbers of matches on which it ran out of time, `times` numbers and seconds of smaller
        sets in the timing; both are brought up to date.
        """
        if isinstance(matched, str):
            return pending.fail(matched)
        [solver] = pending.solvers
        n, numbers = 0, "{}"
        if matched is not None:
            n, numbers = len(matched.matches), solving.known_json(matched, pending.epsilons)
        timed, limit = pending.problem.repeats, pending.limit
        why = _why_not_timed(times[-2:], n, limit) if timed else _why_not_run(slow, n, limit)
        if why:
            return [pending.result(solver, numbers=numbers, skipped=why)]
        allowed = (timed + 1) * (limit + solving.SHORTEST) if timed else limit
        try:
            results = worker.call(solving.solve, pending, matched, self._root, limit=allowed)
        except engine.WorkerError as error:
            if matched is None or not isinstance(error, engine.OutOfTimeError):
                return [pending.result(solver, numbers=numbers, error=_describe(error, limit))]
            slow.append(n)
            skipped = f"took longer than {limit:g} s{' per call' if timed else ''}"
            return [pending.result(solver, numbers=numbers, skipped=skipped)]
        times += [(n, each.seconds) for each in results if each.seconds is not None]
        return results


def _why_not_run(slow: list[int], n: int, limit: float) -> str:
    """Return the reason why a method is not run on n matches; empty if it is run."""
    if sum(fewer <= n for fewer in slow) < GIVEN_UP:
        return ""
    return f"not run: took longer than {limit:g} s on {min(slow):,} matches"


def _why_not_timed(known: list[tuple[int, float]], n: int, budget: float) -> str:
    """Return the reason why a method is not timed on n matches, from smaller sets; empty if it is timed."""
    if not known:
        return ""
    exponent = solving.fit_exponent(*zip(*known, strict=True))
    size, seconds = known[-1]
    expected = seconds * (n / size) ** (UNKNOWN_EXPONENT if np.isnan(exponent) else exponent)
    return f"expected to take {expected:.0f} s per call, more than {budget:g} s" if expected > budget else ""


def _describe(error: engine.WorkerError, limit: float) -> str:
    if isinstance(error, engine.OutOfTimeError):
        return f"{OUT_OF_TIME}: took longer than {limit:g} s"
    return KILLED
