"""Runs small evaluations on a disk that fails, and then on a good one; started with failing_disk.c preloaded.

Prints a line of JSON for every failure that it tried.
"""

import ctypes
import errno
import io
import json
import shutil
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from benchmark_runs import contents
from cgroup.cli import main

FOREVER = 10**9
DISK = ctypes.CDLL(None)


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


def run_failing(config: Path, out: Path, first: int, last: int, reason: int) -> tuple[int, str]:
    """Run while some changes of files in the folder fail."""
    DISK.fail_changes(str(out).encode(), first, last, reason)
    try:
        return run(config, out)
    finally:
        DISK.fail_changes(b"", 0, 0, 0)


def try_all(config: Path, folder: Path, step: int) -> None:
    """Fail at every step-th change, for good or once, for two reasons."""
    whole = folder / "whole"
    DISK.fail_changes(str(whole).encode(), FOREVER, FOREVER, 0)
    run(config, whole)
    changes = DISK.count_changes()
    DISK.fail_changes(b"", 0, 0, 0)
    expected = contents(whole)
    for kind, (reason, last) in enumerate(
        [(errno.ENOSPC, FOREVER), (errno.ENOSPC, 0), (errno.EIO, FOREVER), (errno.EIO, 0)]
    ):
        for first in range(1 + kind % step, changes + 1, step):
            out = folder / f"{kind}-{first}"
            status, errors = run_failing(config, out, first, last or first, reason)
            again = run(config, out)
            outcome = {"at": first, "status": status, "errors": errors.replace(str(out), "OUT")}
            outcome |= {"again": again, "same": contents(out) == expected}
            sys.stdout.write(json.dumps(outcome) + "\n")
            shutil.rmtree(out)


if __name__ == "__main__":
    try_all(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
