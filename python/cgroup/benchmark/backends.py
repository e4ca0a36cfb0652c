"""Work spread over processes or machines by joblib."""

from __future__ import annotations

import itertools
import os
import signal
import warnings
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky.process_executor import TerminatedWorkerError

from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator

BACKENDS = ("loky", "dask", "ray", "threading")

SCHEDULER = "DASK_SCHEDULER_ADDRESS"
"""Environment variable that Dask, too, takes the scheduler's address from."""

_SLICE = 4  # tasks per worker handed out at a time, by backends that can't stream

Result = TypeVar("Result")
Task: TypeAlias = tuple[Any, ...]


class Pool:
    """Workers; made by `pool`."""

    def __init__(self, backend: str, workers: int) -> None:
        self._streams = backend != "ray"
        self._workers = workers

    def unordered(
        self, function: Callable[..., Result], tasks: Iterable[Task]
    ) -> Iterator[tuple[Task, Result | None]]:
        """Call a function with each of many tuples of arguments; results come as they are ready.

        Tuples are drawn as workers become free, so that they needn't all be in memory. To reach another
        machine they had better hold bytes, text, numbers and tuples: Dask puts other large objects on a
        worker, and they are lost with it.

        Yields
        ------
        task, result
            None for the result of a task that killed its worker.
        """
        under_way: dict[int, Task] = {}
        calls = _calls(function, tasks, under_way)
        while True:
            try:
                for number, result in self._streamed(calls) if self._streams else self._sliced(calls):
                    yield under_way.pop(number), result
            except TerminatedWorkerError:  # noqa: PERF203 - rare
                # One of those under way did it; each gets a worker of its own to show which.
                for number in list(under_way):
                    task = under_way.pop(number)
                    yield task, _alone(function, task)
            else:
                return

    def _streamed(self, calls: Iterator[Any]) -> Iterator[tuple[int, Any]]:
        results = _parallel(self._workers, return_as="generator_unordered")(calls)
        with warnings.catch_warnings():
            # On the way out after an interrupt joblib warns of what it couldn't hand over.
            warnings.filterwarnings("ignore", "[0-9]+ tasks", UserWarning)
            with closing(results):
                yield from results

    def _sliced(self, calls: Iterator[Any]) -> Iterator[tuple[int, Any]]:
        parallel = _parallel(self._workers)
        at_once = _SLICE * (self._workers if self._workers > 0 else os.cpu_count() or 1)
        while part := list(itertools.islice(calls, at_once)):
            yield from parallel(part)


def _parallel(workers: int, **options: Any) -> Callable[[Iterable[Any]], Any]:  # noqa: ANN401 - joblib's
    # One task per message: a task takes long enough, and what is under way is lost when a run is killed.
    return Parallel(workers, **options, batch_size=1)  # pyright: ignore[reportArgumentType]


def _calls(
    function: Callable[..., Any], tasks: Iterable[Task], under_way: dict[int, Task]
) -> Iterator[tuple[Callable[..., Any], Task, dict[str, Any]]]:
    for number, task in enumerate(tasks):
        under_way[number] = task
        yield delayed(_numbered)(number, function, *task)


def _numbered(number: int, function: Callable[..., Result], *arguments: object) -> tuple[int, Result]:
    return number, function(*arguments)


def _alone(function: Callable[..., Result], task: Task) -> Result | None:
    try:
        # Two workers, although one task: with one, joblib would work in this very process.
        return _parallel(2)([delayed(function)(*task)])[0]
    except TerminatedWorkerError:
        return None


def _ignore_interrupts() -> None:
    """Leave Ctrl-C, which a terminal sends to every process, to the one that ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def pool(backend: str, workers: int | None, scheduler: str | None = None) -> Generator[Pool, None, None]:
    """Start or reach workers.

    Parameters
    ----------
    backend : str
        One of `BACKENDS`.
    workers : int, optional
        How many; as many as there are cores, or as the cluster has.
    scheduler : str, optional
        Address of a Dask scheduler; that in the environment variable `SCHEDULER` by default.

    Yields
    ------
    Pool

    Raises
    ------
    InputError
        If the backend is unknown or not installed, or no scheduler is known.
    """
    if backend not in BACKENDS:
        message = f"backend: got {backend!r}; choose one of {', '.join(BACKENDS)}"
        raise InputError(message)
    jobs = -1 if workers is None else workers
    if backend == "dask":
        with _dask_backend(scheduler) as dask, parallel_config(dask):
            yield Pool(backend, jobs)
        return
    if backend == "ray":
        _register_ray()
    options: dict[str, Any] = {}
    if backend == "loky":
        options = {"inner_max_num_threads": 1, "initializer": _ignore_interrupts}
    with parallel_config(backend, **options):
        yield Pool(backend, jobs)


@contextmanager
def _dask_backend(scheduler: str | None) -> Generator[Any, None, None]:
    try:
        from distributed import Client  # noqa: PLC0415 - only where it is asked for
    except ModuleNotFoundError as error:
        message = "backend: dask isn't installed; pip install 'dask[distributed]'"
        raise InputError(message) from error
    from cgroup.benchmark.dask_backend import DaskBackend  # noqa: PLC0415 - needs Dask

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
        yield DaskBackend(client=client)


def _register_ray() -> None:
    try:
        # Only where it is asked for.
        from ray.util.joblib import register_ray  # noqa: PLC0415 # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError as error:
        message = "backend: ray isn't installed; pip install 'ray[default]'"
        raise InputError(message) from error
    register_ray()
