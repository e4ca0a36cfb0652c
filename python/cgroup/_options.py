"""Options of the methods, checked by name before the compiled core sees them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cgroup._arguments import as_count, as_number
from cgroup._memory import default_max_memory
from cgroup.errors import InputError
from cgroup.types import RunOptions

if TYPE_CHECKING:
    from collections.abc import Callable

MOST_THREADS = 1024

LEAST_COUNT = {"bins": 1, "iterations": 1, "min_cluster_size": 0, "neighbors": 0, "seed": 0, "voters": 1}
"""Options that are whole numbers, and the least that the core takes."""

NUMBERS = (
    "angle_scale",
    "bin_size",
    "confidence",
    "convergence_tolerance",
    "distance_scale",
    "edge_ratio",
    "lowe_ratio",
    "max_ratio",
    "min_distance_ratio",
    "resolution",
    "tolerance",
    "vote_threshold",
)
"""Options that are real numbers, or None where they may be left out."""


def checked(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options as the core takes them; ranges are its own to check."""
    result = dict(options)
    for name, value in options.items():
        if name in LEAST_COUNT:
            result[name] = as_count(name, value, LEAST_COUNT[name])
        elif (value is not None and name in NUMBERS) or (name == "threshold" and not isinstance(value, str)):
            result[name] = as_number(name, value)
    return result


def run_options(
    threads: int | None = None,
    max_memory: int | None = 0,
    progress: Callable[[float], Any] | None = None,
) -> RunOptions:
    """Check how a computation is to run."""
    if threads is not None and as_count("threads", threads, 1) > MOST_THREADS:
        message = f"threads: got {threads}; give at most {MOST_THREADS}"
        raise InputError(message)
    memory = default_max_memory() if max_memory is None else as_count("max_memory", max_memory, 0)
    return RunOptions(threads, memory, progress)
