"""Progress of a computation: stage times and callbacks."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

from cgroup._checks.values import as_function

if TYPE_CHECKING:
    from collections.abc import Callable


def ignore_progress(*_: object) -> None:
    """Do nothing; stands for a progress callback that was not given."""


def as_stage_function(progress: object) -> Callable[[str], Any]:
    """Return the callback that is told of each stage; one that does nothing for None."""
    return ignore_progress if progress is None else as_function("progress", progress, "the name of a stage")


class StageClock:
    """Takes the time of stages and passes on their names.

    Stages may run side by side, one in each lane. They share the time, so that all times together are the
    time that has passed.
    """

    def __init__(self, progress: Callable[[str], Any] = ignore_progress) -> None:
        self.seconds: dict[str, float] = {}  # wall time of each stage that has begun, summed up
        self._progress = progress
        self._stages: dict[int, str] = {}  # by lane
        self._since = 0.0
        self._lock = threading.Lock()

    def start(self, stage: str, lane: int = 0) -> None:
        """End the stage before, and begin this one."""
        with self._lock:
            self._share_time()
            self._stages.pop(lane, None)
            self._progress(stage)
            self._stages[lane] = stage
            self._since = time.perf_counter()

    def end(self, lane: int) -> None:
        """End the stage of a lane."""
        with self._lock:
            self._share_time()
            self._stages.pop(lane, None)

    def stop(self) -> dict[str, float]:
        """End all stages; return `seconds`."""
        with self._lock:
            self._share_time()
            self._stages.clear()
            return self.seconds

    def _share_time(self) -> None:
        now = time.perf_counter()
        for stage in self._stages.values():
            self.seconds[stage] = self.seconds.get(stage, 0.0) + (now - self._since) / len(self._stages)
        self._since = now
