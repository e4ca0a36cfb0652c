"""Small configurations, and what running them leaves behind."""

import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from cgroup.benchmark.config import parse_config
from cgroup.benchmark.run import Summary, run
from cgroup.benchmark.store import RECORDS

HERE = Path(__file__).parent

MATCHES = """
name = "tiny"
methods = ["ransac", "gtm"]
[[experiment]]
id = "bare"
dataset = "benchmark_fakes:Matches"
"""

GATED = MATCHES.replace('"ransac", "gtm"', '"ransac", "benchmark_fakes:gated"')

CLOUDS = """
name = "tiny"
methods = ["ss", "gc"]
[[experiment]]
id = "noise"
dataset = "benchmark_fakes:Clouds"
nuisance = "benchmark_fakes:noise"
levels = [0.1, 0.2]
pairs = ["a", "b"]
"""


def serial(text: str, out: Path, **options: object) -> Summary:
    return run(parse_config(text), out, backend="threading", workers=1, **options)  # pyright: ignore[reportArgumentType]


def contents(out: Path) -> list[tuple[object, ...]]:
    """Everything that a run computed, apart from times, versions and machines."""
    tables = {
        "matches": "problem, n, content",
        "results": "problem, solver, threads, epsilons, mask, pose, numbers, skipped, error",
        "plan_problems": "*",
    }
    with closing(sqlite3.connect(out / RECORDS)) as connection:
        rows = [
            (table, *row)
            for table, columns in tables.items()
            for row in connection.execute(f"select {columns} from {table}")
        ]
    return sorted(rows, key=repr)


def count(out: Path, table: str) -> int:
    """Rows of a table."""
    try:
        with closing(sqlite3.connect(f"file:{out / RECORDS}?mode=ro", uri=True)) as connection:
            return connection.execute(f"select count(*) from {table}").fetchone()[0]
    except sqlite3.OperationalError:  # not there yet
        return 0


def is_sound(out: Path) -> bool:
    """Whether SQLite finds the file in order."""
    with closing(sqlite3.connect(out / RECORDS)) as connection:
        return connection.execute("pragma integrity_check").fetchall() == [("ok",)]


def make_environment(**more: str) -> dict[str, str]:
    """In which other processes find the fakes."""
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": path, **more}


PROGRAM = """
import signal
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # ignored where the tests were started by nohup
from cgroup.cli import main
main()
"""


def start_benchmark(*arguments: object, **environment: str) -> subprocess.Popen[str]:
    """`cgroup benchmark` as the leader of a process group, which hears when its terminal is closed."""
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, "benchmark", *map(str, arguments)],
        env=make_environment(**environment),
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def cgroup_benchmark(*arguments: object, **environment: str) -> tuple[int, str, str]:
    """`cgroup benchmark` from its beginning to its end: exit status, output, errors."""
    with start_benchmark(*arguments, **environment) as process:
        return finish(process)


def finish(process: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Wait for the end: exit status, output, errors; where it hangs, say at what."""
    try:
        out, err = process.communicate(timeout=120)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGABRT)  # it prints where it is if PYTHONFAULTHANDLER is set
        pytest.fail(f"no end: {process.communicate()}")
    return process.returncode, out, err


def wait_until(condition: Callable[[], object], what: str) -> None:
    """Wait for something that another process does."""
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.02)


class Gate:
    """Lets calls of the method `gated` pass, one by one."""

    def __init__(self, folder: Path) -> None:
        self._path, self._log = folder / "gate", folder / "calls.log"
        for file in (self._path, self._log):
            file.touch()

    @property
    def environment(self) -> dict[str, str]:
        """What tells the method where the gate is."""
        return {"FAKES_GATE": str(self._path), "FAKES_LOG": str(self._log)}

    def open_for(self, calls: int) -> None:
        """Let further calls pass."""
        with self._path.open("a") as file:
            file.write("pass\n" * calls)

    def wait_for(self, calls: int) -> None:
        """Wait until so many calls have begun."""
        wait_until(lambda: self._log.read_text().splitlines().count("gated") >= calls, "no call")
