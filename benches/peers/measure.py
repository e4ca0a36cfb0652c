"""Run one peer on one case, and print its record: one process per run, so that peak memory is its own.

``python -m peers.measure PROGRAM PEER CASE.bin THREADS``
"""

from __future__ import annotations

import ctypes
import gc
import importlib
import json
import os
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from peers.answers import pack, selected_by
from peers.cases import load_case

if TYPE_CHECKING:
    from peers.answers import Answer, Call

MODULES = {
    "cgroup": "peers.cgroup_peers",
    "numpy": "peers.numpy_peers",
    "library": "peers.library_peers",
    "modern": "peers.modern_peers",
}

MARK = "@@"
"""Before the record, as libraries print things of their own."""

MOST_REPETITIONS, LEAST_REPETITIONS = 9, 3
BUDGET = 1.0
LONG = 15.0
"""Up to 9 repetitions within a budget in seconds, but at least 3; a single one if it takes long."""

STATUS = Path("/proc/self/status")
CLEAR_REFS = Path("/proc/self/clear_refs")
RESET_PEAK = "5"


def measure(call: Call) -> tuple[Answer, list[float]]:
    """Repeat a call; its last answer, and the seconds that each took."""
    times: list[float] = []
    while True:
        start = time.perf_counter()
        answer = call()
        times.append(time.perf_counter() - start)
        if (
            len(times) == MOST_REPETITIONS
            or times[-1] > LONG
            or (len(times) >= LEAST_REPETITIONS and sum(times) > BUDGET)
        ):
            return answer, times


def reset_peak() -> None:
    """Hand freed memory back and forget the peak so far, where the system can do so."""
    gc.collect()
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
    with suppress(OSError):
        CLEAR_REFS.write_text(RESET_PEAK, encoding="ascii")


def peak_mib() -> float | None:
    """Peak resident memory since the last reset, None where the system does not tell."""
    with suppress(OSError):
        for line in STATUS.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return round(int(line.split()[1]) / 1024, 2)
    return None


def run(program: str, name: str, case_path: Path, threads: int) -> dict[str, Any]:
    """Measure one peer in this process."""
    case = load_case(case_path)
    call = importlib.import_module(MODULES[program]).PEERS[name](case, threads)
    reset_peak()
    base = peak_mib()
    answer, times = measure(call)
    peak = peak_mib()
    return {
        "times_s": [round(seconds, 7) for seconds in times],
        "base_mib": base,
        "peak_mib": peak,
        "mask": pack(selected_by(case, answer)),
    }


if __name__ == "__main__":
    record = run(sys.argv[1], sys.argv[2], Path(sys.argv[3]), int(sys.argv[4]))
    sys.stdout.flush()
    os.write(1, f"\n{MARK}{json.dumps(record)}\n".encode())  # past whatever a library buffers
