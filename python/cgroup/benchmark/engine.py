"""Pools of worker processes or threads of this machine, or of a Dask cluster.

A worker process gets tasks by its standard input and returns results by its former standard output, each as
the length of a pickle and the pickle. It ends with its parent.
"""

import functools
import itertools
import json
import os
import pickle
import queue
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager, suppress
from typing import Any, TypeAlias

from cgroup._runtime.cluster import WorkersDiedError, reach_cluster, work_on_cluster
from cgroup.errors import InputError

ALL_CORES = 0  # a number of threads
START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from cgroup.benchmark.engine import work; work(int(sys.argv[2]))"
)
"""Program of the process; its arguments are the parent's module path and a number of cores."""

_LENGTH = struct.Struct("<Q")

BACKENDS = ("processes", "dask", "threading")

# Environment variable that Dask, too, takes the scheduler's address from
SCHEDULER = "DASK_SCHEDULER_ADDRESS"
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
    """A process that calls functions; it is restarted if it dies, and ends with this process.

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
        """End the process permanently, including a call in another thread."""
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
    """Start workers, or connect to them: processes of this machine, a Dask cluster, or threads.

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


@contextmanager
def _open_cluster(scheduler: str | None, count: int) -> Generator[CallUnordered, None, None]:
    """Connect to a cluster; each task contains its arguments, so a lost worker loses none."""
    address = scheduler or os.environ.get(SCHEDULER)
    if not address:
        remedy = f"needed by the dask backend; give its address, or set {SCHEDULER}"
        raise InputError("scheduler", remedy=remedy)
    with reach_cluster(address, count) as client:

        def call_unordered(
            function: Callable[..., Any], tasks: Iterable[TaskArguments], limit: float | None
        ) -> Iterator[tuple[TaskArguments, Any]]:
            submit = functools.partial(client.submit, _call_in_process, function, limit, pure=False)
            for task, result in work_on_cluster(client, lambda task: submit(*task), tasks, _IF_LOST):
                yield task, ProcessDiedError() if isinstance(result, WorkersDiedError) else result

        yield call_unordered


_of_thread = threading.local()


def _call_in_process(function: Callable[..., Any], limit: float | None, *arguments: object) -> Any:  # noqa: ANN401 - whatever it returns
    """Call a function in a child process of this cluster worker; each thread has its own child."""
    if not hasattr(_of_thread, "worker"):
        _of_thread.worker = Worker(threads=1)
    return _call_or_error(_of_thread.worker, function, limit, *arguments)


def work(cores: int) -> None:
    """Run tasks on a number of cores, or `ALL_CORES`, until the parent closes the pipe or ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends this process
    if cores != ALL_CORES and hasattr(os, "sched_setaffinity"):  # on Linux; TBB goes by it
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])
    tasks, results = _take_pipes()
    waiting: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    threading.Thread(target=_read_tasks, args=(tasks, waiting), daemon=True).start()
    with suppress(OSError):  # where the parent is gone
        while True:
            function, arguments = pickle.loads(waiting.get())  # noqa: S301 - from the parent
            write_message(lambda part: os.write(results, part), function(*arguments))


def make_ready(_function: Callable[..., Any]) -> None:
    """Do nothing; the call returns once the process has started and imported the function's module."""


def write_message(write: Callable[[memoryview], int | None], value: object) -> None:
    """Pickle a value, and write it in parts."""
    content = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
    rest = memoryview(_LENGTH.pack(len(content)) + content)
    while rest:
        rest = rest[write(rest) :]


def read_message(read: Callable[[int], bytes | None]) -> bytes:
    """Read the next pickle; raise `EOFError` if the pipe is closed."""
    [length] = _LENGTH.unpack(_read_exactly(read, _LENGTH.size))
    return _read_exactly(read, length)


def _read_exactly(read: Callable[[int], bytes | None], length: int) -> bytes:
    parts: list[bytes] = []
    while length:
        part = read(length)
        if not part:
            raise EOFError
        parts.append(part)
        length -= len(part)
    return b"".join(parts)


def _take_pipes() -> tuple[int, int]:
    """Move both pipes to other descriptors, since functions may print or read standard input."""
    tasks, results = os.dup(0), os.dup(1)
    with open(os.devnull, "rb") as nothing:  # noqa: PTH123 - its number is needed
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)
    return tasks, results


def _read_tasks(tasks: int, waiting: queue.SimpleQueue[Any]) -> None:
    """Forward tasks; end the process when the pipe is closed, even during a task."""
    try:
        while True:
            waiting.put(read_message(lambda length: os.read(tasks, length)))
    except (EOFError, OSError):
        end_group(os.getpid())
        os._exit(1)


def end_group(leader: int) -> None:
    """End a worker and the processes that it started."""
    if sys.platform != "win32":
        os.killpg(leader, signal.SIGKILL)
