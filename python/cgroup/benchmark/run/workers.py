"""Work spread over processes or threads of this machine, or over a Dask cluster."""

from __future__ import annotations

import functools
import itertools
import os
import queue
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

from cgroup.benchmark.run.lone_process import LoneProcess, ProcessDiedError
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Generator

BACKENDS = ("processes", "dask", "threading")

Task: TypeAlias = tuple[Any, ...]
CallUnordered: TypeAlias = Callable[[Callable[..., Any], Iterable[Task]], Iterator[tuple[Task, Any]]]
"""Calls a function with each of many tuples of arguments, and yields tuple and result as they are ready.

Tuples are drawn as workers become free, so that they needn't all be in memory. The result of a task that
killed its workers is None.
"""


@contextmanager
def open_workers(
    backend: str, count: int | None, scheduler: str | None = None
) -> Generator[CallUnordered, None, None]:
    """Start or reach workers.

    Parameters
    ----------
    backend : str
        One of `BACKENDS`: processes of this machine, a Dask cluster, or threads of this process.
    count : int, optional
        How many; one per core by default. A cluster has its own number.
    scheduler : str, optional
        Address of a Dask scheduler; the environment says by default.

    Yields
    ------
    CallUnordered
        Puts them to work.

    Raises
    ------
    InputError
        If the backend is unknown or not installed, or no scheduler can be reached.
    """
    if backend not in BACKENDS:
        message = f"backend: got {backend!r}; choose one of {', '.join(BACKENDS)}"
        raise InputError(message)
    count = count or os.cpu_count() or 1
    if backend == "dask":
        opened = _open_cluster(scheduler)
    elif backend == "processes":
        opened = _open_processes(count)
    else:
        opened = _open_threads(count, _call)
    with opened as call:
        yield call


@contextmanager
def _open_cluster(scheduler: str | None) -> Generator[CallUnordered, None, None]:
    try:
        from cgroup.benchmark.run.dask_workers import open_cluster  # noqa: PLC0415 - needs Dask
    except ModuleNotFoundError as error:
        message = "backend: dask isn't installed; pip install 'dask[distributed]'"
        raise InputError(message) from error
    with open_cluster(scheduler) as call:
        yield call


@contextmanager
def _open_processes(count: int) -> Generator[CallUnordered, None, None]:
    processes = [LoneProcess(threads=1) for _ in range(count)]
    idle: queue.SimpleQueue[LoneProcess] = queue.SimpleQueue()
    for process in processes:
        idle.put(process)

    def call(function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401 - whatever it returns
        process = idle.get()
        try:
            return process.call(function, *arguments)
        except ProcessDiedError:
            return None
        finally:
            idle.put(process)

    with _open_threads(count, call) as call_unordered:
        try:
            yield call_unordered
        finally:
            for process in processes:
                process.close()


@contextmanager
def _open_threads(count: int, call: Callable[..., Any]) -> Generator[CallUnordered, None, None]:
    pool = ThreadPoolExecutor(count)
    try:
        # One more is under way than there are threads, so that none waits for the next.
        yield functools.partial(_call_unordered, functools.partial(pool.submit, call), count + 1)
    finally:
        pool.shutdown(cancel_futures=True)


def _call_unordered(
    submit: Callable[..., Future[Any]], at_once: int, function: Callable[..., Any], tasks: Iterable[Task]
) -> Iterator[tuple[Task, Any]]:
    waiting = iter(tasks)
    under_way: dict[Future[Any], Task] = {}
    while True:
        for task in itertools.islice(waiting, at_once - len(under_way)):
            under_way[submit(function, *task)] = task
        if not under_way:
            return
        done, _ = wait(under_way, return_when=FIRST_COMPLETED)
        for future in done:
            yield under_way.pop(future), future.result()


def _call(function: Callable[..., Any], *arguments: object) -> Any:  # noqa: ANN401 - whatever it returns
    return function(*arguments)
