"""Ctrl-C while the command line is being loaded: one line and its exit status, as later on.

Loading takes some tenths of a second, before `cgroup.cli` can catch anything. Where the package is loaded as
a library, and in workers, nothing is changed.
"""

from __future__ import annotations

import os
import signal
import sys
from contextlib import suppress
from typing import NoReturn

INTERRUPTED = 130
"""Exit status of an interrupted command: 128 and the number of the signal."""


def leave_when_interrupted() -> None:
    """End the process at Ctrl-C, if this is the command line and Ctrl-C would otherwise raise."""
    if is_command_line() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        _on_interrupt(_leave)


def raise_when_interrupted() -> None:
    """Let Ctrl-C raise `KeyboardInterrupt` again."""
    if signal.getsignal(signal.SIGINT) is _leave:
        _on_interrupt(signal.default_int_handler)


def is_command_line() -> bool:
    """Whether this process is ``cgroup`` or ``python -m cgroup``, rather than a program that imports it."""
    given = sys.orig_argv[1:]
    name = os.path.splitext(os.path.basename(sys.argv[0]))[0] if sys.argv else ""  # noqa: PTH119, PTH122
    as_script = name in {"cgroup", "cgroup-script"} and sys.argv[0] in given
    return as_script or ("-m" in given and given[given.index("-m") + 1 :][:1] == ["cgroup"])


def _on_interrupt(handler: object) -> None:
    with suppress(ValueError):  # only the main thread may
        signal.signal(signal.SIGINT, handler)  # pyright: ignore[reportArgumentType]


def _leave(*_: object) -> NoReturn:
    with suppress(OSError):
        os.write(2, b"cgroup: interrupted\n")
    os._exit(INTERRUPTED)
