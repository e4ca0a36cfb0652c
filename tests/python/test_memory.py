"""The default bound on the memory of pairwise matrices."""

from __future__ import annotations

import pytest

from cgroup import _memory

GIB = 1 << 30


@pytest.fixture
def system(tmp_path, monkeypatch):
    def write(available_kib=None, limit=None, used=0):
        if available_kib is not None:
            (tmp_path / "meminfo").write_text(f"MemTotal: 1 kB\nMemAvailable: {available_kib} kB\n")
        if limit is not None:
            (tmp_path / "memory.max").write_text(f"{limit}\n")
            (tmp_path / "memory.current").write_text(f"{used}\n")

    monkeypatch.setattr(_memory, "MEMINFO", tmp_path / "meminfo")
    monkeypatch.setattr(_memory, "CONTAINER", tmp_path)
    return write


def test_a_quarter_of_what_is_free(system):
    system(available_kib=4 << 20)
    assert _memory.default_max_memory() == GIB


def test_at_most_one_and_a_half_gibibytes(system):
    system(available_kib=400 << 20, limit="max")
    assert _memory.default_max_memory() == GIB * 3 // 2


def test_a_container_has_its_own_limit(system):
    system(available_kib=400 << 20, limit=GIB, used=GIB // 2)
    assert _memory.default_max_memory() == GIB // 8


def test_a_full_container_leaves_nothing(system):
    system(available_kib=400 << 20, limit=GIB, used=GIB + 1)
    assert _memory.default_max_memory() == 0


def test_some_bound_where_the_system_does_not_tell(system):
    system()
    assert 0 < _memory.default_max_memory() <= 2 * GIB


def test_small_problems_get_a_bound_without_a_look_at_the_system(monkeypatch):
    def fail():
        pytest.fail("looked at the system")

    monkeypatch.setattr(_memory, "default_max_memory", fail)
    assert _memory.max_memory_for(0) == _memory.max_memory_for(900) == _memory.SMALL
    assert _memory.SMALL > 900**2 * 40  # what ST's dense eigensolver takes


def test_large_problems_get_a_share_of_what_is_free(system):
    system(available_kib=4 << 20)
    assert _memory.max_memory_for(5000) == GIB
