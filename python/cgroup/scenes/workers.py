"""Work on pairs of scans, side by side."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

from cgroup._runtime.workers import count_workers, work_side_by_side

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Sequence

    from cgroup.registration import PreparedScan

Task: TypeAlias = tuple[tuple[int, ...], tuple[Any, ...]]
"""Rows of the scans that a function is called with, and its further arguments."""

CallEach: TypeAlias = "Callable[[Callable[..., Any], Sequence[Task]], list[Any]]"
"""Calls a function with the scans and arguments of each task; returns the results in the order of the tasks."""


@contextmanager
def open_workers(
    scans: Sequence[PreparedScan], threads: int | None, scheduler=None, keep=None, begin=None
) -> Generator[CallEach, None, None]:
    """Work on the threads of this process."""

    def call(function: Callable[..., Any], tasks: Sequence[Task]) -> list[Any]:
        def work(task: Task, stop_with_the_others: Callable[[], None]) -> Any:  # noqa: ANN401 - whatever it returns
            stop_with_the_others()
            rows, arguments = task
            return function(*(scans[row] for row in rows), *arguments)

        return work_side_by_side(tasks, work, count_workers(threads))

    yield call
