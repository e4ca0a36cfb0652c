"""Workers of a Dask cluster."""

from __future__ import annotations

import itertools
import os
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, TypeVar

from distributed import Client, KilledWorker, as_completed

from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator

    from distributed import Future

    from cgroup.benchmark.run.workers import Task

SCHEDULER = "DASK_SCHEDULER_ADDRESS"
"""Environment variable that Dask, too, takes the scheduler's address from."""

_PER_THREAD = 2  # tasks handed out per thread of the cluster: one to work on, one to go on with

Result = TypeVar("Result")


@contextmanager
def open_cluster(scheduler: str | None) -> Generator[DaskWorkers, None, None]:
    """Reach a cluster.

    Parameters
    ----------
    scheduler : str, optional
        Address of its scheduler; that in the environment variable `SCHEDULER` by default.

    Yields
    ------
    DaskWorkers

    Raises
    ------
    InputError
        If no address is known, nothing answers there, or the connection is lost later.
    """
    address = scheduler or os.environ.get(SCHEDULER)
    if not address:
        message = f"scheduler: needed by the dask backend; give its address, or set {SCHEDULER}"
        raise InputError(message)
    try:
        client = Client(address, set_as_default=False)
    except (OSError, ValueError) as error:
        message = f"scheduler: {address} can't be reached: {error}"
        raise InputError(message) from error
    with client:
        yield DaskWorkers(client, address)


class DaskWorkers:
    """Workers that may come and go while they work.

    Parameters
    ----------
    client : distributed.Client
        Connected to the scheduler.
    address : str
        Of the scheduler.
    """

    def __init__(self, client: Client, address: str) -> None:
        self._client = client
        self._address = address

    def call_unordered(
        self, function: Callable[..., Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[Task, Result | None]]:
        """Call a function with each of many tuples of arguments, see `Workers`.

        Arguments travel with their task through the scheduler, so that a lost worker takes none with it.

        Raises
        ------
        InputError
            If the connection to the scheduler is lost.
        """
        waiting = iter(tasks)
        under_way: dict[object, tuple[Future[Any], Task]] = {}
        done = as_completed(loop=self._client.loop, raise_errors=False)
        try:
            while True:
                with self._expect_connection():
                    for task in itertools.islice(waiting, self._count_free(len(under_way))):
                        future = self._client.submit(function, *task, pure=False)
                        under_way[future.key] = future, task
                        done.add(future)
                    if not under_way:
                        return
                    future, task = under_way.pop(next(done).key)
                    result = _get_result(future)
                yield task, result
        finally:
            with suppress(OSError, CancelledError):
                self._client.cancel([future for future, _ in under_way.values()])

    def _count_free(self, taken: int) -> int:
        threads: Any = self._client.nthreads()  # by worker
        return max(0, _PER_THREAD * max(sum(threads.values()), 1) - taken)

    @contextmanager
    def _expect_connection(self) -> Generator[None, None, None]:
        try:
            yield
        except (OSError, CancelledError) as error:
            message = f"scheduler: lost the connection to {self._address}; run the command again to continue"
            raise InputError(message) from error


def _get_result(future: Future[Any]) -> Any:  # noqa: ANN401 - whatever the task returned
    """Get the result of a task that is done; None if it killed its workers one after the other."""
    try:
        return future.result()
    except KilledWorker:
        return None
