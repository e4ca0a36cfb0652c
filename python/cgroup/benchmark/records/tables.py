"""Records as tables, for analysis."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup.benchmark.records.checksums import is_whole
from cgroup.benchmark.records.layout import WITH_CHECKSUMS, read_version
from cgroup.benchmark.records.means import add_scores
from cgroup.benchmark.records.packing import floats_from_bytes, unpack, unpack_mask
from cgroup.benchmark.records.reading import (
    describe_damage,
    find_file,
    has_table,
    open_records,
    parse_json,
    query,
    query_one,
)
from cgroup.errors import InputError
from cgroup.evaluation.protocols import PAPER_PROTOCOL, PROTOCOL_PREFIX

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd

    from cgroup.types import BoolArray, Correspondences, FloatArray

FACTS = ("clutter", "occlusion", "overlap")

_SCORES = """
select dataset, cases.origin, pair, nuisance, level, combination, detector, descriptor, nms_radius, facts,
       c.n, s.correct, pr, label as method, w.epsilon, s.selected, s.selected_correct, s.rotation_error,
       s.translation_error, s.rmse as rmse_pr, s.protocols, g.seconds, w.experiments,
       case when c.error <> '' then c.error else coalesce(g.error, '') end as error,
       coalesce(g.version, c.version) as version, seed, coalesce(g.machine, c.machine) as machine,
       w.case_key as "case"
from wanted_scores w
    join cases on cases.key = w.case_key
    join correspondences c on c.case_key = w.case_key
    left join groupings g on g.case_key = w.case_key and g.method_key = w.method_key
    left join scores s on s.case_key = w.case_key and s.method_key = w.method_key and s.epsilon = w.epsilon
where s.case_key is not null or c.error <> '' or g.error <> ''
order by dataset, pair, nuisance, level, nms_radius, combination, w.case_key, place, w.epsilon
"""

_TIMES = """
select label as method, n, threads, repeat, seconds, dataset, pair, machine, version
from plan_timing join timings using (set_key, method_key) join timing_sets on timing_sets.key = set_key
order by n, place, threads, repeat
"""

_SKIPS = """
select label as method, n, threads, reason, machine
from plan_timing join timing_skips using (set_key, method_key) join timing_sets on timing_sets.key = set_key
order by n, place, threads
"""

_GROUPS = """
select distinct label, mask, place from groupings g join plan_methods m using (method_key)
    join plan_cases c on c.entry = m.entry and c.case_key = g.case_key
where g.case_key = ? and g.error = '' order by place
"""


def load(path: Path) -> pd.DataFrame:
    """Read the records: one row per case, method and threshold.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    DataFrame
        `dataset, origin, pair, nuisance, level, combination, detector, descriptor, nms_radius`: the case,
        with "" and NaN for what doesn't apply, and its hash in `case`; `front`: what it changes of the
        paper's front end, as JSON with the keys of `cgroup.benchmark.config.FrontEntry`, "" for nothing;
        `clutter, occlusion, overlap`: facts where they are known; `n, correct, inlier_ratio, pr`: the
        correspondences; `method, epsilon, selected, selected_correct, precision, recall, f_score,
        registered`: the group;
        `rotation_error` (degrees), `translation_error` (data unit), `translation_error_pr`, `rmse_pr`: its
        pose, NaN where it fixes none; ``ok:<protocol>``: registered by a criterion other than the paper's,
        which `registered` is, None where it isn't applicable; `seconds` of the grouping; `experiments`:
        tuple of the ids that use the row; `error`: "" or what went wrong, and then the numbers are NaN;
        `version, seed, machine`.

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
    >>> frame = records.load(Path("results"))
    >>> frame[["method", "n", "correct"]].values.tolist()
    [['gtm', 1000, 20], ['gtm', 1000, 99]]
    """
    frame = query(path, _SCORES)
    facts = [parse_json(text) for text in frame.pop("facts")]
    for name in FACTS:
        frame[name] = np.array([of_pair.get(name, np.nan) for of_pair in facts], dtype=float)
    fronts = _load_fronts(path)
    frame["front"] = [fronts.get(case, "") for case in frame["case"]]
    frame["experiments"] = [tuple(parse_json(text)) for text in frame["experiments"]]
    _expand_protocols(frame)
    for name in ("level", "nms_radius", "rotation_error", "translation_error", "rmse_pr", "seconds"):
        frame[name] = frame[name].astype(float)
    add_scores(frame)
    frame["translation_error_pr"] = frame["translation_error"] / frame["pr"]
    return frame


def load_timing(path: Path) -> pd.DataFrame:
    """Read the times that the latest configuration asked for.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    DataFrame
        One row per method, set and repeat: `method, n, threads` (0: all cores), `repeat, seconds, dataset,
        pair, machine, version`.

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
    >>> len(records.load_timing(Path("results")))  # none was asked for
    0
    """
    return query(path, _TIMES)


def load_timing_skips(path: Path) -> pd.DataFrame:
    """Read which methods weren't timed on which sets.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    DataFrame
        `method, n, threads, reason, machine`.

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
    >>> len(records.load_timing_skips(Path("results")))
    0
    """
    return query(path, _SKIPS)


def load_machines(path: Path) -> pd.DataFrame:
    """Read which machines made records.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    DataFrame
        `id, cpu, cores, system, python, numpy`, one row per machine.

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
    >>> len(records.load_machines(Path("results")))
    1
    """
    return query(path, "select id, cpu, cores, system, python, numpy from machines")


def load_datasets(path: Path) -> pd.DataFrame:
    """Read what is known of the data sets.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    DataFrame
        `name, title, role, origin, citation`, one row per data set.

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
    >>> records.load_datasets(Path("results"))["title"].tolist()
    ['Generated matches']
    """
    return query(path, "select name, title, role, origin, citation from datasets")


def load_config(path: Path) -> dict[str, Any]:
    """Read the latest configuration.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    dict
        Plain values as in its TOML, defaults filled in.

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
    >>> records.load_config(Path("results"))["name"]
    'mine'
    """
    return parse_json(query_one(path, "select config from plan"))


def load_groups(path: Path, case: str) -> tuple[Correspondences, FloatArray, dict[str, BoolArray]]:
    """Read what each method selected in one case.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.
    case : str
        Its hash, from the column `case` of `cgroup.benchmark.records.load`.

    Returns
    -------
    matches : Correspondences
        What the methods were given.
    pose : (4,4) array of float64
        The true pose.
    masks : dict of str to (n,) array of bool
        The group of each method, by its label, in the order of the configuration.

    Raises
    ------
    InputError
        If there are no records of the case, or some aren't what was written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark import records
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gtm"], experiment=[small])
    >>> _ = run(config, Path("results"), backend="threading")
    >>> case = records.load(Path("results"))["case"].iloc[0]
    >>> matches, pose, masks = records.load_groups(Path("results"), case)
    >>> len(matches), pose.shape, list(masks)
    (1000, (4, 4), ['gtm'])
    """
    with open_records(path) as connection:
        arrays = connection.execute("select * from arrays where case_key = ?", (case,)).fetchone()
        checked = read_version(connection) >= WITH_CHECKSUMS
        rows = connection.execute(_GROUPS, (case,)).fetchall()
    if arrays is None:
        message = f"{path}: no records of the case {case}; the column `case` of `load` names those there are"
        raise InputError(message)
    if checked and not is_whole(arrays):
        raise InputError(describe_damage(find_file(path), [f"arrays {case}"]))
    _, content, truth, *_ = arrays
    matches = unpack(content)
    masks = {label: unpack_mask(mask, len(matches)) for label, mask, _ in rows}
    return matches, floats_from_bytes(truth, (4, 4)), masks


def _load_fronts(path: Path) -> dict[str, str]:
    """Read what cases change of the front end, by their hash; in records of older versions none does."""
    if not has_table(path, "fronts"):
        return {}
    with open_records(path) as connection:
        return dict(connection.execute("select case_key, changes from fronts").fetchall())


def _expand_protocols(frame: pd.DataFrame) -> None:
    """Give each criterion but the paper's, which `registered` is, a column of its own."""
    verdicts = [parse_json(text) if isinstance(text, str) else {} for text in frame.pop("protocols")]
    for name in dict.fromkeys(name for row in verdicts for name in row if name != PAPER_PROTOCOL):
        frame[PROTOCOL_PREFIX + name] = np.array([row.get(name) for row in verdicts], dtype=object)
