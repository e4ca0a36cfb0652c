"""Grouping methods compared: each works on every problem by itself, nothing else beside it."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from typing import TYPE_CHECKING

from cgroup.benchmark.records.types import TrialRecord
from cgroup.benchmark.run.lone_process import LoneProcess, OutOfTimeError, ProcessDiedError
from cgroup.benchmark.run.stages import KILLED
from cgroup.benchmark.run.try_method import Facts, describe_problem, try_method

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

    The work is done in one other process. It may die of a method, or be ended when its time is up: that is
    recorded, and the rest goes on in a new one.

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
    for threads in sorted({each.threads for each in pending}):
        with closing(LoneProcess(threads)) as process:
            trials = _Trials(process, folder)
            for each in pending:
                if each.threads == threads:
                    for method in each.methods:
                        records.add(trials.run(each, method))
                        tell(1)


class _Trials:
    """Runs methods, and remembers which ran out of time on how many matches."""

    def __init__(self, process: LoneProcess, root: str | None) -> None:
        self._process = process
        self._root = root
        self._given_up: dict[tuple[int, str], list[int]] = {}

    def run(self, problem: PendingProblem, method: Candidate) -> TrialRecord:
        """Run a method, or say why not."""
        facts = self._describe(problem)
        record = TrialRecord(problem.case, method.key, problem.threads, problem.limit, *facts[:-1])
        if facts.error:
            return replace(record, error=facts.error)
        slow = self._given_up.setdefault((problem.entry, method.key), [])
        if sum(n <= facts.n for n in slow) >= GIVEN_UP:
            reason = f"not run: took longer than {problem.limit:g} s on {min(slow):,} matches"
            return replace(record, skipped=reason)
        try:
            return self._process.call(try_method, record, method, self._root, limit=problem.limit)
        except OutOfTimeError:
            slow.append(facts.n)
            return replace(record, skipped=f"took longer than {problem.limit:g} s")
        except ProcessDiedError:
            return replace(record, error=KILLED)

    def _describe(self, problem: PendingProblem) -> Facts:
        """Have the problem ready there: a new process has to make it again."""
        try:
            return self._process.call(describe_problem, problem.case, self._root)
        except ProcessDiedError:
            return Facts(error=KILLED)
