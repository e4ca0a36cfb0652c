"""Program of a worker process, which calls functions and ends with its parent.

Tasks arrive by standard input and results leave by the former standard output, each as the length of a pickle
and the pickle. Functions print to standard error.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import struct
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import Any

ALL_CORES = 0
"""A number of threads."""

START = (
    "import json, sys; sys.path[:] = json.loads(sys.argv[1]); "
    "from cgroup.benchmark.worker import work; work(int(sys.argv[2]))"
)
"""Program of the process; its arguments are the parent's module path and a number of cores."""

_LENGTH = struct.Struct("<Q")


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
    """Pickle a value, and write it part by part."""
    content = pickle.dumps(value, pickle.HIGHEST_PROTOCOL)
    rest = memoryview(_LENGTH.pack(len(content)) + content)
    while rest:
        rest = rest[write(rest) :]


def read_message(read: Callable[[int], bytes | None]) -> bytes:
    """Read the next pickle; raise `EOFError` if the other side is gone."""
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
    """Move both pipes away from code that reads the standard input or prints."""
    tasks, results = os.dup(0), os.dup(1)
    with open(os.devnull, "rb") as nothing:  # noqa: PTH123 - its number is needed
        os.dup2(nothing.fileno(), 0)
    os.dup2(2, 1)
    return tasks, results


def _read_tasks(tasks: int, waiting: queue.SimpleQueue[Any]) -> None:
    """Pass tasks on; end the process when the pipe is closed, even during a task."""
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
