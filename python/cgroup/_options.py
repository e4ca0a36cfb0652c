"""How a computation runs: on how many threads, in how much memory and time, and who is told how far it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from cgroup._arguments import as_count, as_length
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

MOST_THREADS = 1024


class RunOptions(NamedTuple):
    """Threads, bytes for pairwise matrices, progress callback, seconds of a search; the core reads them."""

    threads: int | None
    max_memory: int
    progress: Callable[[float], Any] | None
    max_seconds: float | None


def run_options(
    threads: int | None = None,
    max_memory: int = 0,
    progress: Callable[[float], Any] | None = None,
    max_seconds: float | None = None,
) -> RunOptions:
    """Check how a computation is to run."""
    if threads is not None and as_count("threads", threads, 1) > MOST_THREADS:
        message = f"threads: got {threads}; give at most {MOST_THREADS}"
        raise InputError(message)
    if progress is not None and not callable(progress):
        message = f"progress: got {progress!r}; give a function that takes the share of the work done"
        raise InputError(message)
    seconds = None if max_seconds is None else as_length("max_seconds", max_seconds)
    return RunOptions(threads, as_count("max_memory", max_memory, 0), progress, seconds)
