"""Options of a computation: threads, memory, time limit, progress callback."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from cgroup._checks.values import as_count, as_function, as_length
from cgroup.errors import InputError

MOST_THREADS = 1024


class RunOptions(NamedTuple):
    """Threads, bytes for pairwise matrices, progress callback, seconds of a search; the core reads them."""

    threads: int | None
    max_memory: int
    progress: Callable[[float], Any] | None
    max_seconds: float | None


def run_options(
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Callable[[float], Any] | None = None,
    max_seconds: float | None = None,
) -> RunOptions:
    """Check how a computation is to run."""
    if progress is not None:
        as_function("progress", progress, "the share of the work done")
    seconds = None if max_seconds is None else as_length("max_seconds", max_seconds)
    memory = 0 if max_memory is None else as_count("max_memory", max_memory, 0)
    return RunOptions(as_threads(threads), memory, progress, seconds)


def as_threads(threads: object) -> int | None:
    """Return a number of threads, None for all cores."""
    if threads is None:
        return None
    count = as_count("threads", threads, 1)
    if count > MOST_THREADS:
        raise InputError("threads", count, f"give at most {MOST_THREADS}")
    return count
