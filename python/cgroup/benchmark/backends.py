"""Work spread over processes or machines by joblib."""

from __future__ import annotations

import itertools
import os
import warnings
from contextlib import closing, contextmanager
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from joblib import Parallel, delayed, parallel_config
from joblib.externals.loky.process_executor import TerminatedWorkerError

from cgroup.errors import CgroupError, InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Generator, Iterable, Iterator

BACKENDS = ("loky", "dask", "ray", "threading")

SCHEDULER = "DASK_SCHEDULER_ADDRESS"

_SLICE = 4  # tasks per worker handed out at a time, by backends that can't stream

Result = TypeVar("Result")
Tasks: TypeAlias = "Iterable[tuple[Any, ...]]"


class Pool:
    """Workers; made by `pool`."""

    def __init__(self, backend: str, workers: int) -> None:
        self._streams = backend != "ray"
        self._workers = workers

    def unordered(self, function: Callable[..., Result], tasks: Tasks) -> Iterator[Result]:
        """Call a function with each of many tuples of arguments; results come as they are ready.

        Arguments are drawn as workers become free, so that they needn't all be in memory. To reach another
        machine they had better be bytes, text, numbers and tuples: Dask puts other large objects on a
        worker, and they are lost with it.

        Raises
        ------
        CgroupError
            If a worker process died.
        """
        try:
            if self._streams:
                yield from self._streamed(function, iter(tasks))
            else:
                yield from self._sliced(function, iter(tasks))
        except TerminatedWorkerError as error:
            message = (
                "a worker process was killed, perhaps for want of memory; everything finished is stored: "
                "run again to continue, with fewer workers"
            )
            raise CgroupError(message) from error

    def _streamed(
        self, function: Callable[..., Result], tasks: Iterator[tuple[Any, ...]]
    ) -> Iterator[Result]:
        # One task per message: a task takes long enough, and what is under way is lost when a run is killed.
        parallel = Parallel(self._workers, return_as="generator_unordered", batch_size=1)
        results: Generator[Result, None, None] = parallel(delayed(function)(*task) for task in tasks)
        with warnings.catch_warnings():
            # On the way out after an interrupt joblib warns of what it couldn't hand over.
            warnings.filterwarnings("ignore", "[0-9]+ tasks", UserWarning)
            with closing(results):
                yield from results

    def _sliced(self, function: Callable[..., Result], tasks: Iterator[tuple[Any, ...]]) -> Iterator[Result]:
        parallel = Parallel(self._workers, batch_size=1)
        at_once = _SLICE * (self._workers if self._workers > 0 else os.cpu_count() or 1)
        while part := list(itertools.islice(tasks, at_once)):
            yield from parallel(delayed(function)(*task) for task in part)


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
        with _dask_client(scheduler) as client, parallel_config("dask", client=client):
            yield Pool(backend, jobs)
        return
    if backend == "ray":
        _register_ray()
    limits = {"inner_max_num_threads": 1} if backend == "loky" else {}
    with parallel_config(backend, **limits):
        yield Pool(backend, jobs)


@contextmanager
def _dask_client(scheduler: str | None) -> Generator[Any, None, None]:
    try:
        from distributed import Client  # noqa: PLC0415 - only where it is asked for
    except ModuleNotFoundError as error:
        message = "backend: dask isn't installed; pip install 'dask[distributed]'"
        raise InputError(message) from error
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
        yield client


def _register_ray() -> None:
    try:
        from ray.util.joblib import register_ray  # noqa: PLC0415 - only where it is asked for
    except ModuleNotFoundError as error:
        message = "backend: ray isn't installed; pip install 'ray[default]'"
        raise InputError(message) from error
    register_ray()
