"""Runs small evaluations on a disk that fails, and then on a good one; started with failing_disk.c preloaded.

Prints a line of JSON for every failure that it tried.
"""

from __future__ import annotations

import ctypes
import errno
import io
import json
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from benchmark_runs import contents
from cgroup.cli import main

FOREVER = 10**9


def run(config: Path, out: Path) -> tuple[int, str]:
    """`cgroup benchmark run` in this process: exit status, and what is on standard error."""
    errors = io.StringIO()
    options = ["--out", str(out), "--backend", "threading", "--workers", "1"]
    with redirect_stderr(errors), redirect_stdout(io.StringIO()):
        try:
            main(["benchmark", "run", str(config), *options])
        except SystemExit as ended:
            return int(ended.code or 0), errors.getvalue()
    raise AssertionError


def try_all(config: Path, folder: Path, step: int) -> None:
    """Fail at every step-th change, for good or once, for two reasons."""
    disk = ctypes.CDLL(None)
    whole = folder / "whole"
    disk.fail_changes(str(whole).encode(), FOREVER, FOREVER, 0)
    run(config, whole)
    changes = disk.count_changes()
    disk.fail_changes(b"", 0, 0, 0)
    expected = contents(whole)
    for kind, (reason, last) in enumerate(
        [(errno.ENOSPC, FOREVER), (errno.ENOSPC, 0), (errno.EIO, FOREVER), (errno.EIO, 0)]
    ):
        for first in range(1 + kind % step, changes + 1, step):
            out = folder / f"{kind}-{first}"
            disk.fail_changes(str(out).encode(), first, last or first, reason)
            status, errors = run(config, out)
            disk.fail_changes(b"", 0, 0, 0)
            again = run(config, out)
            outcome = {"at": first, "status": status, "errors": errors.replace(str(out), "OUT")}
            sys.stdout.write(
                json.dumps({**outcome, "again": again, "same": contents(out) == expected}) + "\n"
            )


if __name__ == "__main__":
    try_all(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
