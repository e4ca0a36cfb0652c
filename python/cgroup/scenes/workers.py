"""Work on pairs of scans in parallel: on threads of this process, or on a Dask cluster."""

from __future__ import annotations

import os
import pickle
import warnings
from collections.abc import Callable, Generator, Sequence
from contextlib import closing, contextmanager, nullcontext
from functools import partial
from typing import Any, NamedTuple, TypeAlias

from cgroup import __version__
from cgroup._checks.values import as_path
from cgroup._runtime.cluster import WorkersDiedError, reach_cluster, work_on_cluster
from cgroup._runtime.progress import ignore_progress
from cgroup._runtime.workers import count_workers, work_side_by_side
from cgroup.errors import InputError
from cgroup.registration import PreparedScan
from cgroup.scenes.kept_links import KeptLinks, Task
from cgroup.scenes.links import Link

CallEach: TypeAlias = "Callable[[Callable[..., Any], Sequence[Task]], list[Any]]"
"""Calls a function with the scans and arguments of each task; returns results in the order of the tasks."""


class _Job(NamedTuple):
    """A function and tasks by number; `begin` is called with each number, `take` with each result."""

    function: Callable[..., Any]
    tasks: dict[int, Task]
    begin: Callable[[int], Any]
    take: Callable[[int, Any], None]


_Run: TypeAlias = "Callable[[_Job], None]"


@contextmanager
def open_workers(
    scans: Sequence[PreparedScan],
    threads: int | None,
    scheduler: object = None,
    keep: str | os.PathLike[str] | None = None,
    begin: Callable[[str], Any] = ignore_progress,
) -> Generator[CallEach, None, None]:
    """Work on threads of this process, or on a Dask cluster; results are identical to the bit.

    `scheduler` is an address, a `distributed.Client`, or "local" for a scheduler of Dask in this process.
    `keep` is a file of finished links, which are not computed again. `begin` gets the name of each pair.
    """
    workers = count_workers(threads)
    file = nullcontext() if keep is None else closing(KeptLinks(as_path("keep", keep), scans))
    on_threads = nullcontext(partial(_run_on_threads, scans, workers))
    with file as kept, on_threads if scheduler is None else _use_cluster(scans, scheduler, workers) as run:

        def call(function: Callable[..., Any], tasks: Sequence[Task]) -> list[Any]:
            results: dict[int, Any] = {} if kept is None else {**kept.find(function, tasks)}

            def take(number: int, result: object) -> None:
                if kept is not None and isinstance(result, Link | None):
                    kept.add(function, tasks[number], result)
                results[number] = result

            left = {number: task for number, task in enumerate(tasks) if number not in results}
            run(_Job(function, left, lambda number: begin(f"pair {number + 1} of {len(tasks)}"), take))
            return [results[number] for number in range(len(tasks))]

        yield call


def _run_on_threads(scans: Sequence[PreparedScan], workers: int, job: _Job) -> None:
    def work(number: int, stop_with_the_others: Callable[[], None]) -> None:
        stop_with_the_others()
        job.begin(number)
        rows, arguments = job.tasks[number]
        job.take(number, job.function(*(scans[row] for row in rows), *arguments))

    work_side_by_side(job.tasks, work, workers)


# --- Dask ------------------------------------------------------------------------------------------


@contextmanager
def _use_cluster(
    scans: Sequence[PreparedScan], scheduler: object, threads: int
) -> Generator[_Run, None, None]:
    """Connect to a cluster, whose workers may come and go.

    Each needed scan is sent to the scheduler once; workers unpickle it, or copy that of another worker.
    """
    sent: dict[int, Any] = {}

    def send(row: int) -> Any:  # noqa: ANN401 - a future of Dask
        if row not in sent:
            with warnings.catch_warnings():
                warnings.filterwarnings("ignore", "Sending large graph")  # it stays there for all tasks
                sent[row] = client.submit(_SentScan, pickle.dumps(scans[row]), __version__, pure=False)
        return sent[row]

    def run(job: _Job) -> None:
        def submit(number: int) -> Any:  # noqa: ANN401 - as above
            job.begin(number)
            rows, arguments = job.tasks[number]
            called = pickle.dumps((job.function, arguments))
            return client.submit(_call, called, *(send(row) for row in rows), pure=False)

        if_lost = "when it is back, call again: with `keep`, finished pairs are not computed again"
        with closing(work_on_cluster(client, submit, job.tasks, if_lost)) as finished:
            for number, result in finished:
                if isinstance(result, WorkersDiedError):
                    rows = " and ".join(str(row) for row in job.tasks[number][0])
                    remedy = f"workers die of scans {rows}; give workers more memory, or leave these out"
                    raise InputError("scheduler", remedy=remedy) from result
                job.take(number, pickle.loads(result))  # noqa: S301 - from a cluster that runs our code

    with reach_cluster(scheduler, threads) as client:
        try:
            yield run
        finally:
            sent.clear()  # so that the cluster forgets them


class _SentScan:
    """A scan on a worker, sent to others as a pickle.

    Otherwise Dask would store received arrays at unaligned addresses.
    """

    def __init__(self, pickled: bytes, version: str) -> None:
        if version != __version__:
            remedy = f"its workers have cgroup {__version__}, not {version} as here; install the same"
            raise InputError("scheduler", remedy=remedy)
        self.scan: PreparedScan = pickle.loads(pickled)  # noqa: S301 - from who runs code here anyway
        self._bytes = len(pickled)

    def __reduce__(self) -> tuple[type[_SentScan], tuple[bytes, str]]:
        return _SentScan, (pickle.dumps(self.scan), __version__)

    def __sizeof__(self) -> int:  # Dask uses it to schedule and store
        return self._bytes


def _call(called: bytes, *sent: _SentScan) -> bytes:
    function, arguments = pickle.loads(called)  # noqa: S301 - as above
    return pickle.dumps(function(*(one.scan for one in sent), *arguments))
