"""Work spread over processes or threads of this machine, or over a Dask cluster."""

from __future__ import annotations

import functools
import signal
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky.process_executor import TerminatedWorkerError

from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Generator

BACKENDS = ("loky", "dask", "threading")

Task: TypeAlias = tuple[Any, ...]
CallUnordered: TypeAlias = Callable[[Callable[..., Any], Iterable[Task]], Iterator[tuple[Task, Any]]]
"""Calls a function with each of many tuples of arguments, and yields tuple and result as they are ready.

Tuples are drawn as workers become free, so that they needn't all be in memory. The result of a task that
killed its worker is None.
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
    if backend == "dask":
        with _open_cluster(scheduler) as call:
            yield call
        return
    options: dict[str, Any] = {}
    if backend == "loky":
        options = {"inner_max_num_threads": 1, "initializer": _ignore_interrupts}
    with parallel_config(backend, **options):
        yield functools.partial(_call_unordered, -1 if count is None else count)


@contextmanager
def _open_cluster(scheduler: str | None) -> Generator[CallUnordered, None, None]:
    try:
        from cgroup.benchmark.run.dask_workers import open_cluster  # noqa: PLC0415 - needs Dask
    except ModuleNotFoundError as error:
        message = "backend: dask isn't installed; pip install 'dask[distributed]'"
        raise InputError(message) from error
    with open_cluster(scheduler) as call:
        yield call


def _call_unordered(
    workers: int, function: Callable[..., Any], tasks: Iterable[Task]
) -> Iterator[tuple[Task, Any]]:
    under_way: dict[int, Task] = {}
    calls = _number_calls(function, tasks, under_way)
    while True:
        try:
            for number, result in _stream(workers, calls):
                yield under_way.pop(number), result
        except TerminatedWorkerError:  # noqa: PERF203 - rare
            # One of those under way did it; each gets a worker of its own to show which.
            for number in list(under_way):
                task = under_way.pop(number)
                yield task, _call_alone(function, task)
        else:
            return


def _stream(workers: int, calls: Iterator[Any]) -> Iterator[tuple[int, Any]]:
    results = _parallel(workers, return_as="generator_unordered")(calls)
    with warnings.catch_warnings():
        # On the way out after an interrupt joblib warns of what it couldn't hand over.
        warnings.filterwarnings("ignore", "[0-9]+ tasks", UserWarning)
        with closing(results):
            yield from results


def _parallel(workers: int, **options: Any) -> Callable[[Iterable[Any]], Any]:  # noqa: ANN401 - joblib's
    # One task per message: a task takes long enough, and what is under way is lost when a run is killed.
    return Parallel(workers, **options, batch_size=1)  # pyright: ignore[reportArgumentType]


def _number_calls(
    function: Callable[..., Any], tasks: Iterable[Task], under_way: dict[int, Task]
) -> Iterator[tuple[Callable[..., Any], Task, dict[str, Any]]]:
    for number, task in enumerate(tasks):
        under_way[number] = task
        yield delayed(_call_numbered)(number, function, *task)


def _call_numbered(number: int, function: Callable[..., Any], *arguments: object) -> tuple[int, Any]:
    return number, function(*arguments)


def _call_alone(function: Callable[..., Any], task: Task) -> Any:  # noqa: ANN401 - whatever it returns
    try:
        # Two workers, although one task: with one, joblib would work in this very process.
        return _parallel(2)([delayed(function)(*task)])[0]
    except TerminatedWorkerError:
        return None


def _ignore_interrupts() -> None:
    """Leave Ctrl-C, which a terminal sends to every process, to the one that ends the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
