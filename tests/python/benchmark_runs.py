"""Small configurations, and what running them leaves behind."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.config import parse_config
from cgroup.benchmark.records.reading import RECORDS
from cgroup.benchmark.records.store import Store
from cgroup.benchmark.run import Summary, run

if TYPE_CHECKING:
    from pathlib import Path

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
