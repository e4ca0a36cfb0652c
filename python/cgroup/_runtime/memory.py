"""Default memory limit of pairwise matrices, and errors for failed allocations."""

import mmap
import os
import sys
from collections.abc import Generator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

import numpy as np

from cgroup.errors import OutOfMemoryError

if sys.platform == "win32":
    resource = None
else:
    import resource

MOST = 3 << 29  # a dense matrix never takes more than 1.5 GiB by default
SHARE_OF_FREE = 4  # and at most one part in four of the free memory
UNKNOWN_FREE = 4 << 30  # bytes assumed free where the system does not report them
# Bytes of a problem so small that a check of the free memory would take longer than its solution
SMALL = 32 << 20
_LARGEST_PAIR = 40  # bytes per pair of correspondences that suffice for the most demanding method
_LINEAR_ALGEBRA = 128 << 20  # bytes of address space that suffice for the buffer of any build of OpenBLAS

PROC = Path("/proc")
CONTROL_GROUPS = Path("/sys/fs/cgroup")  # mount point of control groups


def reserve_linear_algebra() -> None:
    """Allocate OpenBLAS's buffer now; OpenBLAS ends the process if a later allocation fails."""
    try:
        mmap.mmap(-1, _LINEAR_ALGEBRA).close()
    except (OSError, MemoryError) as error:
        size = f"up to {_LINEAR_ALGEBRA >> 20} MiB of address space"
        message = f"no memory for NumPy's linear algebra, which takes {size}; allow the process more memory"
        raise OutOfMemoryError(message) from error
    _ = np.eye(128) @ np.eye(128)  # too large for the kernels of AVX-512 that do without


@contextmanager
def report_refused_memory() -> Generator[None, None, None]:
    """Raise `OutOfMemoryError` in place of the memory errors of NumPy and Python."""
    try:
        yield
    except OutOfMemoryError:
        raise
    except MemoryError as error:
        reason = str(error) or "the system gives no reason"
        remedy = "give fewer points or fewer threads, or allow the process more memory"
        raise OutOfMemoryError(f"no memory ({reason}); {remedy}") from error


def max_memory_for(correspondences: int) -> int:
    """Return the bytes that a pairwise matrix of a number of correspondences may take."""
    small = _LARGEST_PAIR * correspondences**2 <= SMALL
    return SMALL if small else default_max_memory()


def default_max_memory() -> int:
    """Return the limit of a pairwise matrix in bytes: a quarter of the free memory, at most 1.5 GiB."""
    free = min(_free_on_machine(), _free_address_space(), *map(_free_in_group, _groups()))
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


def _free_in_group(folder: Path) -> int:
    """Bytes up to the limit of a control group (version 2)."""
    plenty = MOST * SHARE_OF_FREE
    try:
        limit, used = (int((folder / name).read_text("ascii")) for name in ("memory.max", "memory.current"))
    except (OSError, ValueError):  # "max", or nothing
        return plenty
    # The system keeps some files only while nobody needs the memory.
    return min(plenty, limit - used + (_number_in(folder / "memory.stat", "inactive_file") or 0))


def _number_in(path: Path, name: str) -> int | None:
    """Return the number after a name in a system file; None if it is missing."""
    with suppress(OSError, ValueError):
        for line in path.read_text(encoding="ascii").splitlines():
            if line.split()[:1] == [name]:
                return int(line.split()[1])
    return None


@cache
def _groups() -> list[Path]:
    """Return the folders of the process's control group and of those around it, up to the mount point."""
    group = CONTROL_GROUPS
    with suppress(OSError):
        for line in (PROC / "self/cgroup").read_text(encoding="utf-8").splitlines():
            if line.startswith("0::/"):
                group = CONTROL_GROUPS / line.removeprefix("0::/")
    if not group.is_dir():  # where the mount point is the container's own group
        return [CONTROL_GROUPS]
    return [folder for folder in (group, *group.parents) if folder.is_relative_to(CONTROL_GROUPS)]
