"""Default memory limit of pairwise matrices, and errors where the system refuses memory."""

from __future__ import annotations

import mmap
import os
import re
import sys
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

import numpy as np

from cgroup.errors import OutOfMemoryError

if TYPE_CHECKING:
    from collections.abc import Generator

if sys.platform == "win32":
    resource = None
else:
    import resource

MOST = 3 << 29
"""A dense matrix never takes more than 1.5 GiB by default."""

SHARE_OF_FREE = 4
"""Nor more than one part in four of what is free."""

UNKNOWN_FREE = 4 << 30
"""Taken to be free where the system does not tell."""

SMALL = 32 << 20
"""Bytes that a problem gets without a look at what is free, which takes longer than to solve it."""

_LARGEST_PAIR = 40
"""Bytes per pair of correspondences that suffice for the most demanding method."""

_LINEAR_ALGEBRA = 128 << 20
"""Bytes of address space that suffice for the buffer of any build of OpenBLAS."""

PROC = Path("/proc")
CONTROL_GROUPS = Path("/sys/fs/cgroup")
"""Where control groups are mounted unless the system says otherwise."""


def reserve_linear_algebra() -> None:
    """Have OpenBLAS take its buffer now: where it gets none later, it ends the process.

    Raises
    ------
    OutOfMemoryError
        If there is no room for it.
    """
    try:
        mmap.mmap(-1, _LINEAR_ALGEBRA).close()
    except (OSError, MemoryError) as error:
        message = (
            f"no memory for NumPy's linear algebra, which takes up to {_LINEAR_ALGEBRA >> 20} MiB of address "
            "space; allow the process more memory"
        )
        raise OutOfMemoryError(message) from error
    _ = np.eye(128) @ np.eye(128)  # too large for the kernels of AVX-512 that do without


@contextmanager
def report_refused_memory() -> Generator[None, None, None]:
    """Raise `OutOfMemoryError` in place of NumPy's and Python's own errors of memory."""
    try:
        yield
    except OutOfMemoryError:
        raise
    except MemoryError as error:
        reason = str(error) or "the system says no more"
        message = (
            f"no memory ({reason}); give fewer points or fewer threads, or allow the process more memory"
        )
        raise OutOfMemoryError(message) from error


def max_memory_for(correspondences: int) -> int:
    """Bytes that a pairwise matrix of so many correspondences may take."""
    small = _LARGEST_PAIR * correspondences**2 <= SMALL
    return SMALL if small else default_max_memory()


def default_max_memory() -> int:
    """Bytes that a pairwise matrix may take: a quarter of what is free, at most 1.5 GiB."""
    free = min(_free_on_machine(), _free_address_space(), _free_in_groups())
    return min(MOST, max(free, 0) // SHARE_OF_FREE)


def _free_on_machine() -> int:
    available = _number_in(PROC / "meminfo", "MemAvailable:")
    if available is not None:
        return available << 10
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (OSError, ValueError, AttributeError):
        return UNKNOWN_FREE


def _free_address_space() -> int:
    """Bytes up to the process's limit of address space (`ulimit -v`), if there is one."""
    if resource is None:
        return MOST * SHARE_OF_FREE
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return MOST * SHARE_OF_FREE
    try:
        pages = int((PROC / "self/statm").read_text(encoding="ascii").split()[0])
        return limit - pages * resource.getpagesize()
    except (OSError, ValueError, IndexError):
        return limit


_NO_LIMIT = 1 << 60
"""Version 1 has a number like this where there is no limit."""

_Names = tuple[str, str, str]
"""What a control group's files of its limit and its use are called, and the bytes that can be reclaimed."""

_SECOND = ("memory.max", "memory.current", "inactive_file")
_FIRST = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")


def _free_in_groups() -> int:
    """Bytes up to the nearest of the limits of the process's control groups and those around them."""
    return min((_free_in_group(folder, names) for folder, names in _groups()), default=MOST * SHARE_OF_FREE)


def _free_in_group(folder: Path, names: _Names) -> int:
    plenty = MOST * SHARE_OF_FREE
    try:
        limit, used = (int((folder / name).read_text(encoding="ascii")) for name in names[:2])
    except (OSError, ValueError):  # "max", or nothing
        return plenty
    if limit >= _NO_LIMIT or limit - used >= plenty:
        return plenty
    # The system keeps some files only while nobody needs the memory.
    return limit - used + (_number_in(folder / "memory.stat", names[2]) or 0)


def _number_in(path: Path, name: str) -> int | None:
    """Return the number after a name in a file of the system, if it is there."""
    with suppress(OSError, ValueError):
        for line in path.read_text(encoding="ascii").splitlines():
            if line.split()[:1] == [name]:
                return int(line.split()[1])
    return None


@cache
def _groups() -> list[tuple[Path, _Names]]:
    """Return the folders of the process's memory groups, of either version, and of all around them."""
    return [
        (folder, names)
        for names, place, root, path in _memberships()
        for folder in _with_ancestors(place, root, path)
        if (folder / names[0]).exists()
    ]


def _memberships() -> list[tuple[_Names, Path, str, str]]:
    """Return, for each version in use, its mount point, the group mounted there, and the process's group."""
    found = []
    for line in _lines_of("self/cgroup"):
        _, controllers, path = line.split(":", 2)
        if not controllers:
            found.append((_SECOND, *_mount("cgroup2", ""), path))
        elif "memory" in controllers.split(","):
            found.append((_FIRST, *_mount("cgroup", "memory"), path))
    return found or [(_SECOND, CONTROL_GROUPS, "/", "/"), (_FIRST, CONTROL_GROUPS / "memory", "/", "/")]


def _mount(kind: str, controller: str) -> tuple[Path, str]:
    """Return the mount point of a hierarchy of control groups, and the group that is mounted there."""
    for line in _lines_of("self/mountinfo"):
        place, _, rest = line.partition(" - ")
        fields, described = place.split(), rest.split()
        if len(fields) < 5 or not described or described[0] != kind:
            continue
        if not controller or controller in described[-1].split(","):
            return Path(_unescaped(fields[4])), _unescaped(fields[3])
    return CONTROL_GROUPS / controller, "/"


def _lines_of(name: str) -> list[str]:
    try:
        return (PROC / name).read_text(encoding="utf-8").splitlines()
    except OSError:
        return []


def _with_ancestors(place: Path, root: str, path: str) -> list[Path]:
    """Return the folder of a group and of those around it, up to the mount point."""
    group = PurePosixPath(path)
    inside = group.relative_to(root) if group.is_relative_to(root) else PurePosixPath()
    return [place / inside, *(place / around for around in inside.parents)]


def _unescaped(text: str) -> str:
    """Undo what mountinfo writes for blanks."""
    return re.sub(r"\\([0-7]{3})", lambda match: chr(int(match[1], 8)), text)
