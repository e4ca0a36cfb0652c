"""Records as tables, for analysis."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pandas as pd

from cgroup.benchmark.store import RECORDS
from cgroup.benchmark.timing import FITTED_FROM, fit_exponent
from cgroup.errors import InputError
from cgroup.evaluation.metrics import REGISTERED_PRECISION

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

PROTOCOL_PREFIX = "ok:"
"""Columns with one registration criterion each begin so."""

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
order by dataset, pair, nuisance, level, nms_radius, combination, place, w.epsilon
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


def load(path: Path) -> pd.DataFrame:
    """Read what the latest configuration asked for, one row per case, method and threshold.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    DataFrame
        `dataset, origin, pair, nuisance, level, combination, detector, descriptor, nms_radius`: the case,
        with "" and NaN for what doesn't apply, and its hash in `case`; `clutter, occlusion, overlap`: facts
        where they are known; `n, correct, inlier_ratio, pr`: the correspondences; `method, epsilon,
        selected, selected_correct, precision, recall, f_score, registered`: the group;
        `rotation_error` (degrees), `translation_error` (data unit), `translation_error_pr`, `rmse_pr`: its
        pose, NaN where it fixes none; ``ok:<protocol>``: registered by that criterion, None where it isn't
        applicable; `seconds` of the grouping; `experiments`: tuple of the ids that use the row; `error`: ""
        or what went wrong, and then the numbers are NaN; `version, seed, machine`.

    Raises
    ------
    InputError
        If there are no records.
    """
    frame = _query(path, _SCORES)
    facts = pd.DataFrame([json.loads(text) for text in frame.pop("facts")], index=frame.index)
    for name in FACTS:
        frame[name] = facts[name].astype(float) if name in facts else np.nan
    frame["experiments"] = [tuple(json.loads(text)) for text in frame["experiments"]]
    _expand_protocols(frame)
    for name in ("level", "nms_radius", "rotation_error", "translation_error", "rmse_pr", "seconds"):
        frame[name] = frame[name].astype(float)
    _add_ratios(frame)
    return frame


def load_timing(path: Path) -> pd.DataFrame:
    """Read the times that the latest configuration asked for.

    Parameters
    ----------
    path : path
        As in `load`.

    Returns
    -------
    DataFrame
        One row per method, set and repeat: `method, n, threads` (0: all cores), `repeat, seconds, dataset,
        pair, machine, version`.
    """
    return _query(path, _TIMES)


def load_timing_skips(path: Path) -> pd.DataFrame:
    """Read which methods weren't timed on which sets.

    Parameters
    ----------
    path : path
        As in `load`.

    Returns
    -------
    DataFrame
        `method, n, threads, reason, machine`.
    """
    return _query(path, _SKIPS)


def load_machines(path: Path) -> pd.DataFrame:
    """Read which machines made records: `id, cpu, cores, system, python, numpy`."""
    return _query(path, "select * from machines")


def load_datasets(path: Path) -> pd.DataFrame:
    """Read what is known of the data sets: `name, title, role, origin, citation`."""
    return _query(path, "select * from datasets")


def load_config(path: Path) -> dict[str, Any]:
    """Read the latest configuration: plain values as in its TOML, defaults filled in."""
    return json.loads(str(_query(path, "select config from plan")["config"][0]))


def load_missing(path: Path) -> dict[str, str]:
    """Read which data sets weren't at hand, and why."""
    return json.loads(str(_query(path, "select missing from plan")["missing"][0]))


def exponents(timing: pd.DataFrame, *, threads: int = 1, least: int = FITTED_FROM) -> pd.DataFrame:
    """Fit ``seconds ~ n^a`` to the median times of each method.

    Parameters
    ----------
    timing : DataFrame
        From `load_timing`.
    threads : int
        Which times.
    least : int
        Sets with fewer correspondences are left out.

    Returns
    -------
    DataFrame
        `method, exponent, sizes`: a, NaN for fewer than two sets, and the number of sets.
    """
    kept = timing[(timing["threads"] == threads) & (timing["n"] >= least)]
    rows: list[dict[str, Any]] = []
    for method, times in kept.groupby("method", sort=False):
        medians = times.groupby("n")["seconds"].median()
        exponent = fit_exponent(list(medians.index), list(medians))
        rows.append({"method": method, "exponent": exponent, "sizes": len(medians)})
    return pd.DataFrame(rows, columns=["method", "exponent", "sizes"])


def aggregate(
    frame: pd.DataFrame, by: Sequence[str], how: Literal["macro", "pooled", "median"] = "macro"
) -> pd.DataFrame:
    """Take several pairs together.

    Parameters
    ----------
    frame : DataFrame
        From `load`; rows with an error are left out.
    by : sequence of str
        Columns to group by.
    how : {"macro", "pooled", "median"}
        Mean or median over the pairs, each with the same weight; or the scores of all their matches taken as
        one set.

    Returns
    -------
    DataFrame
        The columns of `by`, the number of `pairs`, `n`, `correct`, `inlier_ratio`, `precision, recall,
        f_score`, `f_of_means` (of mean precision and recall), the shares `registered` and of each protocol
        (among the pairs to which it is applicable), and `seconds`. Shares are means whatever `how` is.

    Raises
    ------
    InputError
        If `how` is none of the three.
    """
    if how not in {"macro", "pooled", "median"}:
        message = f"how: got {how!r}; choose 'macro', 'pooled' or 'median'"
        raise InputError(message)
    protocols = [name for name in frame.columns if name.startswith(PROTOCOL_PREFIX)]
    good = frame[frame["error"] == ""].astype(dict.fromkeys(["registered", *protocols], float))
    groups = good.groupby(list(by), sort=True, dropna=False, observed=True)
    measured = ["n", "correct", "inlier_ratio", "precision", "recall", "f_score", "seconds"]
    combine = "median" if how == "median" else "mean"
    result = groups[measured].agg(combine)
    if how == "pooled":
        totals = groups[["n", "correct", "selected", "selected_correct"]].sum()
        _add_ratios(totals)
        for name in ("inlier_ratio", "precision", "recall", "f_score"):
            result[name] = totals[name]
    result["f_of_means"] = _harmonic(result["precision"], result["recall"])
    shares = groups[["registered", *protocols]].mean()
    result = result.join(shares)
    result.insert(0, "pairs", groups.size())
    return result.reset_index()


def _query(path: Path, text: str) -> pd.DataFrame:
    file = path / RECORDS if path.is_dir() else path
    if not file.exists():
        message = f"{file}: no records; make some with: cgroup benchmark run smoke --out {path}"
        raise InputError(message)
    try:
        with closing(
            sqlite3.connect(f"{file.absolute().as_uri()}?mode=ro", uri=True, timeout=30)
        ) as connection:
            return pd.read_sql_query(text, connection)
    except (sqlite3.Error, pd.errors.DatabaseError) as error:
        message = f"{file}: not a file of records, or of another version: {error}"
        raise InputError(message) from error


def _expand_protocols(frame: pd.DataFrame) -> None:
    judged = [json.loads(text) if isinstance(text, str) else {} for text in frame.pop("protocols")]
    for name in dict.fromkeys(name for row in judged for name in row):
        frame[PROTOCOL_PREFIX + name] = pd.Series(
            [row.get(name) for row in judged], frame.index, dtype=object
        )


def _add_ratios(frame: pd.DataFrame) -> None:
    """Add what follows from the counts; 0 where nothing is selected or correct, NaN without counts."""
    frame["inlier_ratio"] = _ratio(frame["correct"], frame["n"])
    frame["precision"] = _ratio(frame["selected_correct"], frame["selected"])
    frame["recall"] = _ratio(frame["selected_correct"], frame["correct"])
    frame["f_score"] = _harmonic(frame["precision"], frame["recall"])
    frame["registered"] = frame["precision"] > REGISTERED_PRECISION
    if "translation_error" in frame:
        frame["translation_error_pr"] = frame["translation_error"] / frame["pr"]


def _ratio(part: pd.Series, whole: pd.Series) -> pd.Series:
    return (part / whole.where(whole != 0, 1)).astype(float)


def _harmonic(precision: pd.Series, recall: pd.Series) -> pd.Series:
    total = precision + recall
    return 2 * precision * recall / total.where(total != 0, 1)
