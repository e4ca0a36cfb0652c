"""One other process that works alone, and may die of what it is given, or be stopped."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from cgroup.benchmark.run.worker import ALL_CORES, START, end_group, read_message, write_message
from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

_TRIES = 3  # so that a process ended from outside isn't blamed on the call

_THREAD_VARIABLES = (
    *("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS"),
    *("VECLIB_MAXIMUM_THREADS", "NUMBA_NUM_THREADS", "NUMEXPR_NUM_THREADS"),
)


class ProcessDiedError(Exception):
    """The process died of the call."""


class OutOfTimeError(Exception):
    """The call took longer than it was given, and the process was ended."""


class LoneProcess:
    """A process that calls functions, started again after it died; it ends with this one, in any case.

    Parameters
    ----------
    threads : int
        Told to its libraries before any loads; `ALL_CORES` for all.
    cores : int
        Where the system allows the process is kept to so many, for libraries that can't be told.
    """

    def __init__(self, threads: int, cores: int = ALL_CORES) -> None:
        self._threads = threads
        self._cores = cores
        self._lock = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False

    def call(self, function: Callable[..., Any], *arguments: object, limit: float | None = None) -> Any:  # noqa: ANN401 - whatever it returns
        """Call a function there; again in a new process, twice at most, if it dies.

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
            If the process dies of it, or is closed meanwhile.
        OutOfTimeError
            If it takes longer than the limit.
        InputError
            If the system starts no process.
        """
        for _ in range(_TRIES):
            with suppress(EOFError, OSError):
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
        """End the process for good; a call that is under way in another thread ends with it."""
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
            message = f"workers: the system starts no process ({error.strerror or error}); try fewer workers"
            raise InputError(message) from error

    def _kill(self, process: subprocess.Popen[bytes]) -> None:
        with self._lock:
            if process.returncode is None:  # else its id may be another's by now
                with suppress(ProcessLookupError, PermissionError):
                    end_group(process.pid)
                process.kill()

    def _forget(self, process: subprocess.Popen[bytes]) -> None:
        """End a process that is of no use any more."""
        self._kill(process)
        with self._lock:
            process.wait()
            if self._process is process:
                self._process = None
                for pipe in (process.stdin, process.stdout):
                    if pipe is not None:
                        pipe.close()
