"""Run many single-threaded computations in parallel."""

import functools
import os
import sys
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

from cgroup._checks.values import as_count
from cgroup.errors import OutOfMemoryError

if TYPE_CHECKING or sys.version_info >= (3, 12):
    from functools import cached_property
else:

    class cached_property(functools.cached_property):  # noqa: N801 - as the standard library's
        """`functools.cached_property` of Python 3.12; before, one lock blocks all objects of a class."""

        def __get__(self, instance: object, owner: type | None = None) -> object:
            if instance is None:
                return self
            return vars(instance).setdefault(self.attrname, self.func(instance))


__all__ = ["cached_property"]

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def count_workers(threads: int | None) -> int:
    """Return the number of parallel computations: the given number, or one per core."""
    return os.cpu_count() or 1 if threads is None else as_count("threads", threads, 1)


def work_side_by_side(
    items: Iterable[_Item], work: Callable[[_Item, Callable[[], None]], _Result], workers: int
) -> list[_Result]:
    """Process all items in parallel, and return the results in order; the first error ends the others."""
    # `work` takes an item, and a function to be called every now and then: it raises `InterruptedError` once
    # another item has failed, or the user has interrupted.
    stopped = threading.Event()

    def stop_with_the_others() -> None:
        if stopped.is_set():
            raise InterruptedError

    pool = ThreadPoolExecutor(max_workers=workers)
    try:
        try:
            results = pool.map(lambda item: work(item, stop_with_the_others), items)
        except RuntimeError as error:  # of the pool, which starts its threads here
            remedy = "give fewer threads, or allow the process more threads or more memory"
            message = f"the system does not start {workers} threads ({error}); {remedy}"
            raise OutOfMemoryError(message) from error
        return list(results)
    finally:
        stopped.set()
        pool.shutdown(cancel_futures=True)
