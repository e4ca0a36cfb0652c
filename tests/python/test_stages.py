"""Stages that run side by side, and properties computed by several threads."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from cgroup._runtime import progress
from cgroup._runtime.cached import cached_property
from cgroup._runtime.progress import StageClock


def test_stages_side_by_side_share_the_time(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([0.0, 1.0, 3.0, 4.0, 8.0, 9.0])
    monkeypatch.setattr(progress.time, "perf_counter", lambda: next(times))
    told: list[str] = []
    clock = StageClock(told.append)
    clock._since = 0.0
    clock.start("one", 0)  # looks twice: before the callback and after it
    clock.start("other", 1)
    clock.end(0)
    assert clock.stop() == {"one": 2.0 + 2.0, "other": 2.0 + 1.0}
    assert told == ["one", "other"]


def test_properties_of_two_objects_are_computed_at_the_same_time() -> None:
    both = threading.Barrier(2)

    class Slow:
        @cached_property
        def value(self) -> int:
            return both.wait(timeout=30)

    with ThreadPoolExecutor(2) as pool:
        objects = Slow(), Slow()
        assert sorted(pool.map(lambda one: one.value, objects)) == [0, 1]
    assert sorted(vars(one)["value"] for one in objects) == [0, 1]
    assert sorted(one.value for one in objects) == [0, 1]
    assert isinstance(Slow.value, cached_property)
