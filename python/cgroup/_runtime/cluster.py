"""Connect to a Dask cluster, and run tasks on it."""

import itertools
import logging
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from typing import Any, TypeVar

from cgroup._checks.values import refusal
from cgroup.errors import InputError

_Task = TypeVar("_Task")

# In place of an address: a scheduler and threads in this process, which no other process can reach
LOCAL = "local"
_PER_THREAD = 2  # tasks handed out per thread of a cluster: one to work on, one to go on with
_LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")


class WorkersDiedError(Exception):
    """Raised if a task has killed several workers in a row."""


@contextmanager
def reach_cluster(scheduler: object, threads: int = 1) -> Generator[Any, None, None]:
    """Return the client of a cluster: the given one, or a new one for the scheduler's address."""
    # `LOCAL` starts one in this process, with this number of threads. A given client stays open.
    try:
        from distributed import Client  # noqa: PLC0415 - optional
        from distributed.comm.addressing import get_address_host_port  # noqa: PLC0415
    except ModuleNotFoundError as error:
        remedy = "dask isn't installed; pip install 'dask[distributed]'"
        raise InputError("scheduler", remedy=remedy) from error
    with _hold_back_logs(), ExitStack() as opened:
        if isinstance(scheduler, Client):
            if scheduler.asynchronous:
                raise InputError("scheduler", "an asynchronous client", "give a synchronous one")
            yield scheduler
            return
        if not isinstance(scheduler, str):
            raise refusal("scheduler", scheduler, f"give an address, a distributed.Client, or {LOCAL!r}")
        try:
            if scheduler == LOCAL:
                address: Any = opened.enter_context(_local_cluster(threads))
            else:
                address = scheduler
                get_address_host_port(address)  # a client with an invalid address hangs when it is closed
            client = opened.enter_context(Client(address, set_as_default=False))
        except (OSError, ValueError) as error:
            raise InputError("scheduler", repr(scheduler), f"it can't be reached: {error}") from error
        yield client


@contextmanager
def _local_cluster(threads: int) -> Generator[Any, None, None]:
    """Start a cluster within the process; with an open port, any local process could run code."""
    from distributed import LocalCluster  # noqa: PLC0415 - optional

    nowhere = "127.0.0.1:0"  # Dask opens ports for HTTP even without a dashboard
    cluster: Any = LocalCluster(
        n_workers=1, threads_per_worker=threads, processes=False, memory_limit=0, dashboard_address=nowhere,
        worker_dashboard_address=nowhere, scheduler_kwargs={"dashboard": False},
        silence_logs=logging.CRITICAL,
    )  # fmt: skip

    async def close_ports() -> None:
        for node in (cluster.scheduler, *cluster.workers.values()):
            node.http_server.stop()

    with cluster:
        cluster.sync(close_ports)
        yield cluster


def work_on_cluster(
    client: Any,  # noqa: ANN401 - of Dask, which may not be installed
    submit: Callable[[_Task], Any],
    tasks: Iterable[_Task],
    if_lost: str,
) -> Generator[tuple[_Task, Any], None, None]:
    """Submit tasks as workers become free; yield each finished task with its result."""
    # `submit` gives a task to the client and returns the future. A task that has ended several workers has a
    # `WorkersDiedError` as its result. Running and failed tasks are cancelled at the end.
    from distributed import KilledWorker, as_completed  # noqa: PLC0415 - optional

    waiting = iter(tasks)
    under_way: dict[object, tuple[Any, _Task]] = {}
    done = as_completed(loop=client.loop, raise_errors=False)
    try:
        while True:
            with _report_lost_scheduler(if_lost):
                # As many tasks as the current workers can run.
                threads = max(sum(client.nthreads().values()), 1)
                for task in itertools.islice(waiting, max(0, _PER_THREAD * threads - len(under_way))):
                    future = submit(task)
                    under_way[future.key] = future, task
                    done.add(future)
                if not under_way:
                    return
                future, task = under_way[next(done).key]
                error = future.exception()
                if isinstance(error, CancelledError):
                    raise error
                result = future.result() if error is None else None
            if isinstance(error, KilledWorker):
                result = WorkersDiedError()
            elif isinstance(error, ImportError):
                remedy = f"its workers can't import what they need ({error}); install there what is here"
                raise InputError("scheduler", remedy=remedy) from error
            elif error is not None:
                raise error
            del under_way[future.key]
            yield task, result
    finally:
        with suppress(OSError, CancelledError):
            client.cancel([future for future, _ in under_way.values()])


@contextmanager
def _hold_back_logs() -> Generator[None, None, None]:
    """Suppress Dask's tracebacks of errors that are reported here."""
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


@contextmanager
def _report_lost_scheduler(remedy: str) -> Generator[None, None, None]:
    try:
        yield
    except (OSError, CancelledError) as error:
        reason = getattr(error, "reason", error)  # a cancelled future has a reason of several lines
        raise InputError("scheduler", remedy=f"the connection is lost ({reason}); {remedy}") from error
