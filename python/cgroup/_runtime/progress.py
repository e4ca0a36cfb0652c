"""Progress of a computation: times of stages, and callbacks."""

import time
from collections.abc import Callable
from typing import Any

from cgroup._checks.values import as_function


def ignore_progress(*_: object) -> None:
    """Do nothing; replaces a missing progress callback."""


def as_stage_function(progress: object) -> Callable[[str], Any]:
    """Return a callback for the names of stages; for None, one that does nothing."""
    return ignore_progress if progress is None else as_function("progress", progress, "the name of a stage")


class StageClock:
    """Measures the times of stages, and passes their names to a callback."""

    def __init__(self, progress: Callable[[str], Any] = ignore_progress) -> None:
        self.seconds: dict[str, float] = {}  # wall time of each stage that has ended, summed up
        self._progress = progress
        self._stage: str | None = None
        self._since = 0.0

    def start(self, stage: str) -> None:
        """End the previous stage, and begin this one."""
        self.stop()
        self._progress(stage)
        self._stage, self._since = stage, time.perf_counter()

    def stop(self) -> dict[str, float]:
        """End the last stage; return `seconds`."""
        if self._stage is not None:
            passed = time.perf_counter() - self._since
            self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + passed
        self._stage = None
        return self.seconds
