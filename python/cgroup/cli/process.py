"""The process: standard output and error, which may be closed or full, and termination signals."""

import os
import signal
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from types import FrameType
from typing import Any, TextIO, cast

from cgroup._runtime.interrupts import once_loaded

_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")  # Windows lacks the last


class OutputError(Exception):
    """Standard output can't be written; `is_closed` if its reader, such as ``head``, has ended."""

    def __init__(self, error: OSError) -> None:
        super().__init__(f"standard output: can't be written ({error.strerror or error})")
        self.is_closed = isinstance(error, BrokenPipeError)


class _Output:
    """Standard output that raises `OutputError` for its own errors."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        return self._guard(self._stream.write, text)

    def flush(self) -> None:
        self._guard(self._stream.flush)

    def _guard(self, function: Callable[..., Any], *arguments: str) -> Any:
        try:
            return function(*arguments)
        except OSError as error:
            raise OutputError(error) from error

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def guarded_output() -> Generator[None, None, None]:
    """Raise `OutputError` if standard output can't be written; escape characters it can't encode."""
    before = _open_streams()
    sys.stdout = cast("TextIO", _Output(before))
    try:
        yield
        sys.stdout.flush()
    except OutputError:
        _drop(before)
        raise
    finally:
        sys.stdout = before


def write_error(line: str) -> None:
    """Write a line to standard error, if possible."""
    try:
        sys.stderr.write(line + "\n")
        sys.stderr.flush()
    except (OSError, ValueError):
        _drop(sys.stderr)


def _open_streams() -> TextIO:
    """Replace streams that are closed by the null device; return standard output."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: PTH123, SIM115 - till the end
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    return sys.stdout


def _drop(stream: TextIO) -> None:
    with suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


class StoppedError(KeyboardInterrupt):
    """Raised after a termination signal, whose number is in the exit status."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.status = 128 + number


@contextmanager
def stop_on_signals() -> Generator[None, None, None]:
    """Raise `StoppedError` at the first termination signal; end at once at the second.

    Ignored signals stay ignored, as those of a background process. Afterwards the process is expected to end.
    """
    stopped = False

    def stop(number: int, _frame: FrameType | None) -> None:
        nonlocal stopped
        if stopped:
            with suppress(OSError):
                os.write(2, b"cgroup: interrupted\n")
            os._exit(128 + number)
        stopped = True
        raise StoppedError(number)

    numbers = [getattr(signal, name) for name in _ENDING if hasattr(signal, name)]
    before = {number: signal.getsignal(number) for number in numbers}
    for number, handler in before.items():
        if handler not in (signal.SIG_IGN, None):
            signal.signal(number, once_loaded(stop))
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:  # a stopped process only has its message left to print
                signal.signal(number, signal.SIG_IGN if stopped else handler)
