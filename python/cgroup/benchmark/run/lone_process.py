"""One other process that works alone, and may die of what it is given, or be stopped."""

from __future__ import annotations

import multiprocessing
import os
import signal
from contextlib import suppress
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable
    from multiprocessing.connection import Connection
    from multiprocessing.process import BaseProcess


ALL_CORES = 0
"""A number of threads."""


class ProcessDiedError(Exception):
    """The process died of the call."""


class OutOfTimeError(Exception):
    """The call took longer than it was given, and the process was ended."""


class LoneProcess:
    """A process that calls functions, started again after it died; it ends with this one, in any case.

    Parameters
    ----------
    threads : int
        Told to its libraries before any loads, and where the system allows the process is kept to so many
        cores; `ALL_CORES` for all.
    """

    def __init__(self, threads: int) -> None:
        self._threads = threads
        self._process: BaseProcess | None = None
        self._pipe: Any = None

    def call(self, function: Callable[..., Any], *arguments: object, limit: float | None = None) -> Any:  # noqa: ANN401 - whatever it returns
        """Call a function there.

        Parameters
        ----------
        function : callable
            Importable by its name.
        *arguments
            Its arguments.
        limit : float, optional
            Seconds after which the process is ended.

        Returns
        -------
        object
            What the function returns; it must not raise.

        Raises
        ------
        ProcessDiedError
            If the process dies of it.
        OutOfTimeError
            If it takes longer than the limit.
        """
        pipe = self._pipe or self._start()
        try:
            pipe.send((function, arguments))
            if pipe.poll(limit):
                return pipe.recv()
        except (EOFError, OSError) as error:
            self.close()
            raise ProcessDiedError from error
        self.close()
        raise OutOfTimeError

    def _start(self) -> Any:  # noqa: ANN401 - its type depends on the system
        spawn = multiprocessing.get_context("spawn")
        self._pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_work, args=(theirs, self._threads), daemon=True)
        self._process.start()
        theirs.close()  # so that the pipe ends with the process
        return self._pipe

    def close(self) -> None:
        """End the process."""
        if self._process is not None and self._pipe is not None:
            self._pipe.close()
            self._process.terminate()
            self._process.join()
        self._process = self._pipe = None


def _work(pipe: Connection[Any, Any], threads: int) -> None:
    """Call what comes through a pipe until it is closed."""
    _prepare_process(threads)
    with suppress(EOFError, OSError):
        while True:
            function, arguments = pipe.recv()
            pipe.send(function(*arguments))


def _prepare_process(threads: int) -> None:
    """Limit the threads of libraries that can't be told otherwise, and leave Ctrl-C to the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if threads == ALL_CORES:
        return
    os.environ["OMP_NUM_THREADS"] = str(threads)
    if hasattr(os, "sched_setaffinity"):  # on Linux; what TBB goes by
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:threads])
