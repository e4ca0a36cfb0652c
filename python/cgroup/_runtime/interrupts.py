"""Handling of Ctrl-C while modules are loaded and while Python exits.

An interrupt then ends the command in one line with its exit status. Loading the command line takes some
tenths of a second, before `cgroup.cli` can catch anything. A library import and worker processes keep
Python's handling.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import time
from _thread import get_ident, start_new_thread
from collections.abc import Callable
from contextlib import suppress
from importlib.machinery import ExtensionFileLoader
from types import FrameType
from typing import NoReturn, TypeAlias

Handler: TypeAlias = Callable[[int, FrameType | None], None] | signal.Handlers

INTERRUPTED = 130  # exit status of an interrupted command: 128 and the number of the signal
# What runs as long as a compiled module is being loaded
_COMPILED_LOADING = (ExtensionFileLoader.create_module.__code__, ExtensionFileLoader.exec_module.__code__)
_SECONDS_UNTIL_AGAIN = 0.01  # after which a signal that came where it couldn't be raised is sent again


def watch_for_interrupts() -> None:
    """Install the Ctrl-C handlers of the command line; does nothing in other programs. Call it once."""
    leave_when_interrupted()
    if signal.getsignal(signal.SIGINT) is _leave:
        sys.unraisablehook = _send_again_or_print
        # Runs after all other exit handlers; afterwards Ctrl-C would kill a finished process.
        atexit.register(_on_interrupt, signal.SIG_IGN)


def leave_when_interrupted() -> None:
    """End the process at Ctrl-C, if this is the command line and Ctrl-C would otherwise raise."""
    if is_command_line() and signal.getsignal(signal.SIGINT) in (signal.default_int_handler, _raise):
        _on_interrupt(_leave)


def raise_when_interrupted() -> None:
    """Make Ctrl-C raise `KeyboardInterrupt` again."""
    if signal.getsignal(signal.SIGINT) is _leave:
        _on_interrupt(_raise)


def once_loaded(handle: Callable[[int, FrameType | None], None]) -> Handler:
    """Delay a handler that raises until no compiled module is being loaded."""
    # One that is cut short may turn the interrupt into an `ImportError`, and abort the process at its end.

    def handle_once_loaded(number: int, frame: FrameType | None) -> None:
        if _loads_compiled_module(frame):
            _send_again(number)
        else:
            _handled.append(number)
            handle(number, frame)

    return handle_once_loaded


def was_interrupted() -> bool:
    """Return whether an interrupt was raised, even if compiled code has replaced it by another error."""
    return bool(_handled)


def is_command_line() -> bool:
    """Whether this process is ``cgroup`` or ``python -m cgroup``, rather than a program that imports it."""
    given = sys.orig_argv[1:]
    name = os.path.splitext(os.path.basename(sys.argv[0]))[0] if sys.argv else ""  # noqa: PTH119, PTH122
    as_script = name in {"cgroup", "cgroup-script"} and sys.argv[0] in given
    return as_script or ("-m" in given and given[given.index("-m") + 1 :][:1] == ["cgroup"])


def _on_interrupt(handle: Handler) -> None:
    with suppress(ValueError):  # only the main thread may
        signal.signal(signal.SIGINT, handle)


_raise = once_loaded(signal.default_int_handler)
_handled: list[int] = []


def _loads_compiled_module(frame: FrameType | None) -> bool:
    while frame is not None and frame.f_code not in _COMPILED_LOADING:
        frame = frame.f_back
    return frame is not None


def _send_again_or_print(lost: sys.UnraisableHookArgs) -> None:
    """Print an error that a callback could not raise; send an interrupt again."""
    if issubclass(lost.exc_type, KeyboardInterrupt):
        _send_again(signal.SIGINT)
    else:
        sys.__unraisablehook__(lost)


def _send_again(number: int) -> None:
    start_new_thread(_send_later, (number, get_ident()))


def _send_later(number: int, thread: int) -> None:
    time.sleep(_SECONDS_UNTIL_AGAIN)
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(thread, number)  # wakes it where it waits
    else:
        signal.raise_signal(number)


def _leave(*_: object) -> NoReturn:
    with suppress(OSError):
        os.write(2, b"cgroup: interrupted\n")
    os._exit(INTERRUPTED)
