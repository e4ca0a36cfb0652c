"""Telling how far a computation is, and taking the time of its stages."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable


def ignore_progress(*_: object) -> None:
    """Take any progress report, and do nothing: the default of progress callbacks."""


class StageClock:
    """Takes the time of named stages, and passes on their names.

    Parameters
    ----------
    progress : callable, optional
        Called with the name of each stage as it begins.
    """

    def __init__(self, progress: Callable[[str], Any] | None = None) -> None:
        self.seconds: dict[str, float] = {}
        self._progress = progress or ignore_progress
        self._stage: str | None = None
        self._since = 0.0

    def start(self, stage: str) -> None:
        """Begin a stage; the one before ends."""
        self.stop()
        self._progress(stage)
        self._stage, self._since = stage, time.perf_counter()

    def stop(self) -> None:
        """End the stage that is under way, if any."""
        if self._stage is not None:
            self.seconds[self._stage] = time.perf_counter() - self._since
        self._stage = None
