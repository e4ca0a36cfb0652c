"""How much memory a pairwise matrix may take when the user does not say."""

from __future__ import annotations

import os
from pathlib import Path

MOST = 3 << 29
"""A dense matrix never takes more than 1.5 GiB by default."""

SHARE_OF_FREE = 4
"""Nor more than one part in four of what is free."""

UNKNOWN_FREE = 4 << 30
"""Taken to be free where the system does not tell."""

SMALL = 32 << 20
"""Bytes that a problem gets without a look at what is free, which takes longer than to solve it."""

_LARGEST_PAIR = 40
"""Bytes per pair of correspondences that the most demanding method, ST's dense eigensolver, needs."""

MEMINFO = Path("/proc/meminfo")
CONTAINER = Path("/sys/fs/cgroup")


def max_memory_for(correspondences: int) -> int:
    """Bytes that a pairwise matrix of so many correspondences may take."""
    small = _LARGEST_PAIR * correspondences**2 <= SMALL
    return SMALL if small else default_max_memory()


def default_max_memory() -> int:
    """Bytes that a pairwise matrix may take: a quarter of what is free, at most 1.5 GiB."""
    return min(MOST, max(min(_free_on_machine(), _free_in_container()), 0) // SHARE_OF_FREE)


def _free_on_machine() -> int:
    try:
        for line in MEMINFO.read_text(encoding="ascii").splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) << 10
    except (OSError, ValueError):
        pass
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (OSError, ValueError, AttributeError):
        return UNKNOWN_FREE


def _free_in_container() -> int:
    """Bytes up to the limit that a container sets, if it does."""
    try:
        limit, used = (
            (CONTAINER / name).read_text(encoding="ascii") for name in ("memory.max", "memory.current")
        )
        return int(limit) - int(used)
    except (OSError, ValueError):
        return MOST * SHARE_OF_FREE
