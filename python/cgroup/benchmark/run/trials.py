"""Grouping methods compared: each works on every problem by itself, nothing else beside it."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

from cgroup.benchmark.records.types import TrialRecord
from cgroup.benchmark.run.lone_process import LoneProcess, OutOfTimeError, ProcessDiedError
from cgroup.benchmark.run.problems import PreparedProblem, try_to_prepare
from cgroup.benchmark.run.stages import KILLED
from cgroup.benchmark.run.try_method import make_ready, try_method
from cgroup.benchmark.run.worker import ALL_CORES

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path
    from typing import Any

    from cgroup.benchmark.candidates import Candidate
    from cgroup.benchmark.records.trials import PendingProblem, Trials

GIVEN_UP = 2
"""Calls of a method that ran out of time in a set; on problems of no fewer matches it isn't tried again."""


def try_methods(
    pending: list[PendingProblem], records: Trials, root: Path | None, tell: Callable[[int], Any]
) -> None:
    """Run methods on problems.

    Problems are made in one other process and methods run in another, which thereby holds nothing but the
    matches. It may die of a method, or be ended when its time is up: that is recorded, and the rest goes on
    in a new one.

    Parameters
    ----------
    pending : list of PendingProblem
        What the records lack.
    records : Trials
        Where they go to.
    root : path, optional
        Folder with the data; the environment says by default.
    tell : callable
        Called with the number of new records.
    """
    folder = None if root is None else str(root)
    with closing(LoneProcess(ALL_CORES)) as maker:
        for threads in sorted({each.threads for each in pending}):
            with closing(LoneProcess(threads, cores=threads)) as process:
                trials = _Trials(process)
                for each in pending:
                    if each.threads == threads:
                        problem = _prepare(maker, each, folder)
                        for method in each.methods:
                            records.add(trials.run(each, problem, method))
                            tell(1)


def _prepare(maker: LoneProcess, pending: PendingProblem, root: str | None) -> PreparedProblem | str:
    try:
        return maker.call(try_to_prepare, pending.case, root)
    except ProcessDiedError:
        return KILLED


class _Trials:
    """Runs methods, and remembers which ran out of time on how many matches."""

    def __init__(self, process: LoneProcess) -> None:
        self._process = process
        self._given_up: dict[tuple[int, str], list[int]] = {}

    def run(self, pending: PendingProblem, problem: PreparedProblem | str, method: Candidate) -> TrialRecord:
        """Run a method, or say why not; a problem that couldn't be made is the error."""
        record = TrialRecord(pending.case, method.key, pending.threads, pending.limit)
        if isinstance(problem, str):
            return replace(record, error=problem)
        n = len(problem.matches)
        record = replace(
            record,
            n=n,
            correct=int(problem.correct.sum()),
            resolution=problem.resolution,
            pr=problem.pr,
            overlap=problem.overlap,
        )
        slow = self._given_up.setdefault((pending.entry, method.key), [])
        if sum(fewer <= n for fewer in slow) >= GIVEN_UP:
            reason = f"not run: took longer than {pending.limit:g} s on {min(slow):,} matches"
            return replace(record, skipped=reason)
        try:
            self._process.call(make_ready)
            return self._process.call(try_method, record, method, problem, limit=pending.limit)
        except OutOfTimeError:
            slow.append(n)
            return replace(record, skipped=f"took longer than {pending.limit:g} s")
        except ProcessDiedError:
            return replace(record, error=KILLED)
