"""Pools of worker processes or threads of this machine, or of a Dask cluster."""

from __future__ import annotations

import functools
import itertools
import json
import os
import pickle
import queue
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from typing import Any, TypeAlias

from cgroup._runtime.cluster import WorkersDiedError, reach_cluster, work_on_cluster
from cgroup.benchmark.worker import ALL_CORES, START, end_group, make_ready, read_message, write_message
from cgroup.errors import InputError

BACKENDS = ("processes", "dask", "threading")

SCHEDULER = "DASK_SCHEDULER_ADDRESS"
"""Environment variable that Dask, too, takes the scheduler's address from."""

TaskArguments: TypeAlias = tuple[Any, ...]
CallUnordered: TypeAlias = Callable[
    [Callable[..., Any], Iterable[TaskArguments], float | None], Iterator[tuple[TaskArguments, Any]]
]
"""Calls a function with each of many tuples of arguments; yields tuple and result when they are ready.

Tuples are drawn when workers become free. Each call may have a limit in seconds. The result of a call that
killed its workers or exceeded its limit is the `WorkerError`.
"""

_IF_LOST = "run the same command again to continue"
_TRIES = 3  # the process may have been ended from outside
_THREAD_VARIABLES = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS"),
    *("VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS", "NUMEXPR_NUM_THREADS"),
)


class WorkerError(Exception):
    """The call has no result."""


class ProcessDiedError(WorkerError):
    """The call ended its process."""


class OutOfTimeError(WorkerError):
    """The call exceeded its limit, and its process was ended."""


class Worker:
    """A process that calls functions, and is started again if it dies; it ends with this one.

    The number of threads is set before any library loads. Where possible the process is restricted to a
    number of cores. Both may be `ALL_CORES`.
    """

    def __init__(self, threads: int, cores: int = ALL_CORES) -> None:
        self._threads = threads
        self._cores = cores
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False

    def call(self, function: Callable[..., Any], *arguments: object, limit: float | None = None) -> Any:  # noqa: ANN401 - whatever it returns
        """Call an importable function that doesn't raise; return its result.

        If the process dies, the call is repeated in a new one, at most twice, before `ProcessDiedError` is
        raised. Raises `OutOfTimeError` after the limit in seconds, and `InputError` if no process starts.
        """
        for _ in range(_TRIES):
            with suppress(EOFError, OSError):
                if limit is not None:  # starting a process takes part of it
                    self._call_once(make_ready, (function,), None)
                return self._call_once(function, arguments, limit)
        raise ProcessDiedError

    def _call_once(
        self, function: Callable[..., Any], arguments: tuple[object, ...], limit: float | None
    ) -> Any:  # noqa: ANN401 - as above
        process = self._start()
        out_of_time = threading.Event()

        def stop() -> None:
            out_of_time.set()
            self._kill(process)

        assert process.stdin is not None  # noqa: S101 - both are pipes
        assert process.stdout is not None  # noqa: S101
        timer = threading.Timer(limit or 0, stop)
        try:
            if limit is not None:
                timer.start()
            write_message(process.stdin.write, (function, arguments))
            return pickle.loads(read_message(process.stdout.read))  # noqa: S301 - from a process of one's own
        except (EOFError, OSError) as error:
            self._forget(process)
            if out_of_time.is_set():
                raise OutOfTimeError from error
            raise
        finally:
            timer.cancel()

    def close(self) -> None:
        """End the process for good, with any call in another thread."""
        with self._lock:
            self._closed = True
            process = self._process
        if process is not None:
            self._forget(process)

    def _start(self) -> subprocess.Popen[bytes]:
        with self._lock:
            if self._closed:
                raise EOFError
            if self._process is None:
                self._process = self._open()
            return self._process

    def _open(self) -> subprocess.Popen[bytes]:
        environment = dict(os.environ)
        if self._threads != ALL_CORES:
            environment |= dict.fromkeys(_THREAD_VARIABLES, str(self._threads))
        try:
            return subprocess.Popen(  # noqa: S603 - this very interpreter
                [sys.executable, "-c", START, json.dumps(sys.path), str(self._cores)],
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=environment,
                start_new_session=True,  # out of reach of the terminal's signals
            )
        except OSError as error:
            remedy = f"the system starts no process ({error.strerror or error}); try fewer workers"
            raise InputError("workers", remedy=remedy) from error

    def _kill(self, process: subprocess.Popen[bytes]) -> None:
        with self._lock:
            if process.returncode is None:  # else its id may be another's by now
                with suppress(ProcessLookupError, PermissionError):
                    end_group(process.pid)
                process.kill()

    def _forget(self, process: subprocess.Popen[bytes]) -> None:
        """End a process, and close its pipes."""
        self._kill(process)
        with self._lock:
            process.wait()
            if self._process is process:
                self._process = None
                for pipe in (process.stdin, process.stdout):
                    if pipe is not None:
                        pipe.close()


@contextmanager
def open_workers(
    backend: str, count: int | None, scheduler: str | None = None
) -> Generator[CallUnordered, None, None]:
    """Start or reach workers: processes of this machine, a Dask cluster, or threads of this process.

    `count` is one per core by default; a cluster has its own. The scheduler's address is by default that of
    the environment. `InputError` is raised if the backend is unknown or missing, or the scheduler is lost.
    """
    if backend not in BACKENDS:
        raise InputError("backend", repr(backend), f"choose one of {', '.join(BACKENDS)}")
    count = count or os.cpu_count() or 1
    if backend == "dask":
        opened = _open_cluster(scheduler, count)
    elif backend == "processes":
        opened = _open_processes(count)
    else:
        opened = _open_threads(count, lambda function, _limit, *arguments: function(*arguments))
    with opened as call:
        yield call


@contextmanager
def _open_processes(count: int) -> Generator[CallUnordered, None, None]:
    workers = [Worker(threads=1) for _ in range(count)]
    idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
    for worker in workers:
        idle.put(worker)

    def call(function: Callable[..., Any], limit: float | None, *arguments: object) -> Any:  # noqa: ANN401 - whatever it returns
        worker = idle.get()
        try:
            return _call_or_error(worker, function, limit, *arguments)
        finally:
            idle.put(worker)

    with _open_threads(count, call) as call_unordered:
        try:
            yield call_unordered
        finally:
            for worker in workers:
                worker.close()


def _call_or_error(
    worker: Worker, function: Callable[..., Any], limit: float | None, *arguments: object
) -> Any:  # noqa: ANN401 - whatever it returns
    """Return the result of a function in a worker's process, or the error."""
    try:
        return worker.call(function, *arguments, limit=limit)
    except WorkerError as error:
        return error


@contextmanager
def _open_threads(count: int, call: Callable[..., Any]) -> Generator[CallUnordered, None, None]:
    pool = ThreadPoolExecutor(count)

    def call_unordered(
        function: Callable[..., Any], tasks: Iterable[TaskArguments], limit: float | None
    ) -> Iterator[tuple[TaskArguments, Any]]:
        waiting = iter(tasks)
        under_way: dict[Future[Any], TaskArguments] = {}
        while True:
            # One more than there are threads, so that none waits for the next.
            for task in itertools.islice(waiting, count + 1 - len(under_way)):
                under_way[pool.submit(call, function, limit, *task)] = task
            if not under_way:
                return
            done, _ = wait(under_way, return_when=FIRST_COMPLETED)
            for future in done:
                yield under_way.pop(future), future.result()

    try:
        yield call_unordered
    finally:
        pool.shutdown(cancel_futures=True)


# --- Dask ------------------------------------------------------------------------------------------


@contextmanager
def _open_cluster(scheduler: str | None, count: int) -> Generator[CallUnordered, None, None]:
    """Reach a cluster; arguments travel with their task, so that a lost worker loses none."""
    address = scheduler or os.environ.get(SCHEDULER)
    if not address:
        remedy = f"needed by the dask backend; give its address, or set {SCHEDULER}"
        raise InputError("scheduler", remedy=remedy)
    with reach_cluster(address, count) as client:
        yield functools.partial(_call_on_cluster, client)


def _call_on_cluster(
    client: Any,  # noqa: ANN401 - of Dask, which may not be installed
    function: Callable[..., Any],
    tasks: Iterable[TaskArguments],
    limit: float | None,
) -> Iterator[tuple[TaskArguments, Any]]:
    def submit(task: TaskArguments) -> Any:  # noqa: ANN401 - a future of Dask
        return client.submit(_call_in_process, function, limit, *task, pure=False)

    for task, result in work_on_cluster(client, submit, tasks, _IF_LOST):
        yield task, ProcessDiedError() if isinstance(result, WorkersDiedError) else result


_of_thread = threading.local()


def _call_in_process(function: Callable[..., Any], limit: float | None, *arguments: object) -> Any:  # noqa: ANN401 - whatever it returns
    """Call a function in a process beside this worker of a cluster; each of its threads has one."""
    if not hasattr(_of_thread, "worker"):
        _of_thread.worker = Worker(threads=1)
    return _call_or_error(_of_thread.worker, function, limit, *arguments)
