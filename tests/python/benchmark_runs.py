"""Small configurations, and what running them leaves behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from cgroup.benchmark.config import parse_config
from cgroup.benchmark.records.reading import RECORDS
from cgroup.benchmark.records.store import Store
from cgroup.benchmark.run import Summary, run

HERE = Path(__file__).parent

MATCHES = """
name = "tiny"
methods = ["ransac", "gtm"]
[[experiment]]
id = "bare"
dataset = "benchmark_fakes:Matches"
"""

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
    store = Store(out / RECORDS)
    tables = {
        "correspondences": "case_key, n, pr, facts, parameters, error",
        "arrays": "case_key, content, truth, sample",
        "groupings": "case_key, method_key, mask, threshold, pose, diagnostics, parameters, error",
        "scores": "*",
        "plan_cases": "*",
    }
    rows = [
        (table, *row)
        for table, columns in tables.items()
        for row in store.connection.execute(f"select {columns} from {table}")
    ]
    store.close()
    return sorted(rows, key=repr)


def make_environment(**more: str) -> dict[str, str]:
    """In which other processes find the fakes."""
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": path, **more}


def start_benchmark(*arguments: object, **environment: str) -> subprocess.Popen[str]:
    """`cgroup benchmark` as the leader of a process group."""
    return subprocess.Popen(
        [sys.executable, "-c", "from cgroup.cli import main; main()", "benchmark", *map(str, arguments)],
        env=make_environment(**environment),
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def cgroup_benchmark(*arguments: object, **environment: str) -> tuple[int, str, str]:
    """`cgroup benchmark` from its beginning to its end: exit status, output, errors."""
    with start_benchmark(*arguments, **environment) as process:
        out, err = process.communicate(timeout=120)
    return process.returncode, out, err
