"""Stop a long computation cleanly on SIGINT, SIGTERM and SIGHUP."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator
from contextlib import contextmanager, suppress
from types import FrameType

from cgroup._runtime.interrupts import once_loaded

_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")  # Windows lacks the last


class StoppedError(KeyboardInterrupt):
    """A signal asked the process to end; the exit status contains its number."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.status = 128 + number


@contextmanager
def stop_on_signals() -> Generator[None, None, None]:
    """Raise `StoppedError` at the first signal that asks the process to end; end at once at the second.

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
