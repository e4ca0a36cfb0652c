"""Stop a long computation in good order on SIGINT, SIGTERM and SIGHUP."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator
from contextlib import contextmanager, suppress
from types import FrameType

from cgroup._runtime.interrupts import once_loaded

_ENDING = ("SIGINT", "SIGTERM", "SIGHUP")  # Windows lacks the last


class StoppedError(KeyboardInterrupt):
    """The process was told to end; its exit status says by which signal."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.status = 128 + number


@contextmanager
def stop_on_signals() -> Generator[None, None, None]:
    """Raise `StoppedError` at the first signal that asks the process to end; end at once at the second.

    Ctrl-C, a request to terminate and a terminal that is closed are the same here. Signals that are ignored
    stay so, as those of a program in the background. Afterwards the process is expected to end.
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
            if handler is not None:  # once it is stopped, the process only has to say so
                signal.signal(number, signal.SIG_IGN if stopped else handler)
