"""Workers of a Dask cluster, which may come and go while they work."""

from __future__ import annotations

import functools
import itertools
import logging
import os
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from distributed import Client, KilledWorker, as_completed

from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator

    from distributed import Future

    from cgroup.benchmark.run.workers import CallUnordered, Task

SCHEDULER = "DASK_SCHEDULER_ADDRESS"
"""Environment variable that Dask, too, takes the scheduler's address from."""

_LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")

_PER_THREAD = 2  # tasks handed out per thread of the cluster: one to work on, one to go on with


@contextmanager
def open_cluster(scheduler: str | None) -> Generator[CallUnordered, None, None]:
    """Reach a cluster.

    Parameters
    ----------
    scheduler : str, optional
        Address of its scheduler; that in the environment variable `SCHEDULER` by default.

    Yields
    ------
    CallUnordered
        Puts the cluster to work. Arguments travel with their task through the scheduler, so that a lost
        worker takes none with it. Raises `InputError` if the scheduler is lost.

    Raises
    ------
    InputError
        If no address is known, or nothing answers there.
    """
    address = scheduler or os.environ.get(SCHEDULER)
    if not address:
        message = f"scheduler: needed by the dask backend; give its address, or set {SCHEDULER}"
        raise InputError(message)
    with _hold_back_logs():
        try:
            client = Client(address, set_as_default=False)
        except (OSError, ValueError) as error:
            message = f"scheduler: {address} can't be reached: {error}"
            raise InputError(message) from error
        with client:
            yield functools.partial(_call_unordered, client)


@contextmanager
def _hold_back_logs() -> Generator[None, None, None]:
    """Keep Dask from printing tracebacks of what is reported here."""
    loggers = [logging.getLogger(name) for name in _LOGGERS]
    before = [(logger, logger.handlers[:], logger.propagate) for logger in loggers]
    for logger in loggers:
        logger.handlers[:] = [logging.NullHandler()]
        logger.propagate = False
    try:
        yield
    finally:
        for logger, handlers, propagate in before:
            logger.handlers[:] = handlers
            logger.propagate = propagate


def _call_unordered(
    client: Client, function: Callable[..., Any], tasks: Iterable[Task]
) -> Iterator[tuple[Task, Any]]:
    waiting = iter(tasks)
    under_way: dict[object, tuple[Future[Any], Task]] = {}
    done = as_completed(loop=client.loop, raise_errors=False)
    try:
        while True:
            with _report_lost_scheduler():
                for task in itertools.islice(waiting, _count_free(client, len(under_way))):
                    future = client.submit(function, *task, pure=False)
                    under_way[future.key] = future, task
                    done.add(future)
                if not under_way:
                    return
                future, task = under_way.pop(next(done).key)
                result = _get_result(future)
            yield task, result
    finally:
        with suppress(OSError, CancelledError):
            client.cancel([future for future, _ in under_way.values()])


def _count_free(client: Client, taken: int) -> int:
    """Count the tasks that the workers that are there now can take."""
    threads: Any = client.nthreads()  # by worker
    return max(0, _PER_THREAD * max(sum(threads.values()), 1) - taken)


def _get_result(future: Future[Any]) -> Any:  # noqa: ANN401 - whatever the task returned
    """Get the result of a task that is done; None if it killed its workers one after the other."""
    try:
        return future.result()
    except KilledWorker:
        return None


@contextmanager
def _report_lost_scheduler() -> Generator[None, None, None]:
    try:
        yield
    except (OSError, CancelledError) as error:
        message = f"scheduler: the connection is lost ({error}); run the same command again to continue"
        raise InputError(message) from error
