"""Dask clusters of processes that tests can kill, as on several machines."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import TYPE_CHECKING

from benchmark_runs import make_environment, wait_until

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

Cluster = tuple[str, list[subprocess.Popen[bytes]]]


def make_cluster(folder: Path, failures: int = 3, workers: int = 3) -> Iterator[Cluster]:
    """Address of a scheduler; processes of the workers, each of one thread, and, last, of the scheduler.

    A task may have been on so many workers that failed, and is tried on another.
    """
    folder.mkdir(exist_ok=True)
    file = folder / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    common = ["--scheduler-file", str(file), "--no-dashboard"]
    patient = make_environment(DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES=str(failures))
    command = [*dask, "worker", *common, "--nthreads", "1", "--no-nanny"]
    scheduler = _start([*dask, "scheduler", *common, "--port", "0"], folder, patient)
    started = [_start(command, folder, make_environment()) for _ in range(workers)]
    try:
        wait_until(lambda: file.exists() and file.read_text(), "no scheduler")
        yield json.loads(file.read_text())["address"], [*started, scheduler]
    finally:
        for process in (*started, scheduler):
            process.kill()
            process.wait()


def _start(command: list[str], folder: Path, environment: dict[str, str]) -> subprocess.Popen[bytes]:
    quiet = subprocess.DEVNULL
    return subprocess.Popen(command, env=environment, cwd=folder, stdout=quiet, stderr=quiet)
