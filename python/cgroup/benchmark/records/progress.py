"""How far the stages of a run are, and what failed."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from cgroup.benchmark.records.reading import open_records, parse_json, query_one
from cgroup.benchmark.records.schema import FAILURES

if TYPE_CHECKING:
    import sqlite3
    from pathlib import Path

_FAILED = "coalesce(r.error, '') <> ''"

_STAGES = {
    "correspond": ("wanted_cases", "correspondences", "case_key", _FAILED),
    "group": ("wanted_groupings", "groupings", "case_key, method_key", _FAILED),
    "score": ("wanted_scores", "scores", "case_key, method_key, epsilon", "0"),
    "register": ("wanted_registrations", "registrations", "case_key, pipeline_key, threads", _FAILED),
    "try": ("wanted_trials", "trials", "case_key, method_key, threads", _FAILED),
}


class Counts(NamedTuple):
    """How far one stage is."""

    done: int
    failed: int
    wanted: int


def load_counts(path: Path) -> dict[str, Counts]:
    """Read how far each stage is with what the latest configuration asks for."""
    with open_records(path) as connection:
        return count_records(connection)


def load_failures(path: Path) -> list[tuple[str, str, int]]:
    """Read what failed: the method or pipeline (empty for the first stage), the error, and how often."""
    with open_records(path) as connection:
        known = _list_tables(connection)
        rows = [row for table, text in FAILURES.items() if table in known for row in connection.execute(text)]
    return sorted(rows, key=lambda row: -row[2])


def load_missing(path: Path) -> dict[str, str]:
    """Read which data sets and pipelines weren't at hand, and why."""
    return parse_json(query_one(path, "select missing from plan"))


def count_records(connection: sqlite3.Connection) -> dict[str, Counts]:
    """Count what is done, failed and wanted, of each stage that the file's version has."""
    known = _list_tables(connection)
    counts: dict[str, Counts] = {}
    for stage, (wanted, records, key, failed) in _STAGES.items():
        if records in known:
            done, bad, total = connection.execute(
                f"select count(r.case_key), coalesce(sum({failed}), 0), count(*) "
                f"from {wanted} left join {records} r using ({key})"
            ).fetchone()
            counts[stage] = Counts(done - bad, bad, total)
    return counts


def _list_tables(connection: sqlite3.Connection) -> set[str]:
    return {row[0] for row in connection.execute("select name from sqlite_master where type = 'table'")}
