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
    """Read how far each stage is with what the latest configuration asks for.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    dict of str to Counts
        Done, failed and wanted records of the stages "correspond", "group", "score", "register", "try".

    Raises
    ------
    InputError
        If there are no records, or some aren't what was written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark import records
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gtm"], experiment=[small])
    >>> _ = run(config, Path("results"), backend="threading")
    >>> records.load_counts(Path("results"))["group"]
    Counts(done=2, failed=0, wanted=2)
    """
    with open_records(path) as connection:
        return count_records(connection)


def load_failures(path: Path) -> list[tuple[str, str, int]]:
    """Read what failed, the most frequent first.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    list of (str, str, int)
        The method or pipeline (empty where matching failed), the error, and how often it came.

    Raises
    ------
    InputError
        If there are no records, or some aren't what was written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark import records
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gtm"], experiment=[small])
    >>> _ = run(config, Path("results"), backend="threading")
    >>> records.load_failures(Path("results"))
    []
    """
    with open_records(path) as connection:
        known = _list_tables(connection)
        rows = [row for table, text in FAILURES.items() if table in known for row in connection.execute(text)]
    return sorted(rows, key=lambda row: -row[2])


def load_missing(path: Path) -> dict[str, str]:
    """Read which data sets and pipelines weren't at hand, and why.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    dict of str to str
        Reasons by name.

    Raises
    ------
    InputError
        If there are no records, or some aren't what was written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark import records
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gtm"], experiment=[small])
    >>> _ = run(config, Path("results"), backend="threading")
    >>> records.load_missing(Path("results"))
    {}
    """
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
