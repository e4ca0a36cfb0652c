"""Results as tables of pandas, and means over them."""

import functools
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from cgroup._checks.values import as_path
from cgroup._runtime.toml import read_packaged
from cgroup.benchmark.problem import COMBINATIONS, Task
from cgroup.benchmark.results import ERRORS, unpack
from cgroup.benchmark.solving import fit_exponent
from cgroup.benchmark.store import Counts, count_results, open_records
from cgroup.datasets.generated_matches import GeneratedMatches, read_recipe
from cgroup.errors import InputError
from cgroup.evaluation.metrics import harmonic_mean, score_counts
from cgroup.evaluation.protocols import PAPER_PROTOCOL, PROTOCOL_PREFIX, PROTOCOLS
from cgroup.types import BoolArray, Correspondences, FloatArray

__all__ = ["aggregate", "exponents", "load", "load_groups"]

FITTED_FROM = 2000  # exponents are fitted to sets of at least this many matches
_ORDERS = {"registration": "p.dataset, p.pair, p.kind, p.other"}
_ORDER = "q.place, t.value"

_FLOATS = ("level", "nms_radius", "voxel", "epsilon", "seconds")  # columns of numbers that may all be missing
_TEXTS = ("protocols", "definition", "numbers")
_GROUPS: dict[str, Any] = {
    **dict.fromkeys(("n", "correct"), 0),
    **dict.fromkeys(("resolution", "pr", "overlap", "clutter", "occlusion"), math.nan),
    **dict.fromkeys(("selected", "selected_correct"), 0),
    "posed": False,
    "ok": None,
    "complete": True,
    **dict.fromkeys(ERRORS, math.nan),
    **{f"best_{name}": math.nan for name in ERRORS},
    "offered": 0,
    "mebibytes": math.nan,
    "diagnostics": "{}",
    "truth": None,
}
_MEASURES: dict[Task, dict[str, Any]] = {
    "experiment": _GROUPS,
    "matches": _GROUPS,
    "timing": {"n": 0, "repeats": ()},
    "registration": {
        **dict.fromkeys(("voxel", "pr", "overlap", "probability", "decoy", "nees", *ERRORS), math.nan),
        "ok": False,
        "stages": {},
        "truth": None,
    },
    "scenes": {
        "voxel": math.nan,
        **dict.fromkeys(("scans", "right", "mixed", "found", "wanted", "placed", "tried"), 0),
        **dict.fromkeys(("rotation", "translation"), ()),
        "stages": {},
    },
}
"""Columns from a result's numbers, with the values of a result without them."""


def load(path: Path | str, kind: Task = "experiment") -> pd.DataFrame:
    """Read the results of the latest configuration.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.
    kind : {"experiment", "timing", "registration", "scenes", "matches"}
        Results of the experiments, of the timing, of pipelines on two clouds or on many scans, or of methods
        run alone on matches.

    Returns
    -------
    DataFrame
        One row per problem, solver, number of threads and threshold. The documentation of the benchmark lists
        the columns of each kind.

    Examples
    --------
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> from cgroup.benchmark.tables import load
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gtm"], experiment=[small])
    >>> _ = run(config, "results", backend="threading")
    >>> frame = load("results")
    >>> frame[["method", "n", "correct"]].values.tolist()
    [['gtm', 1000, 20], ['gtm', 1000, 99]]
    """
    if kind not in _MEASURES:
        raise InputError(f"kind: got {kind!r}; choose one of {', '.join(_MEASURES)}")
    frame = _load(as_path("path", path), kind)
    if kind == "timing":
        frame = frame[(frame["skipped"] == "") & (frame["error"] == "")]
        frame = frame.assign(repeat=[list(enumerate(each)) for each in frame.pop("repeats")])
        frame = frame.explode("repeat").sort_values("n", kind="stable", ignore_index=True)
        pairs = frame["repeat"].tolist()
        frame["repeat"] = np.array([repeat for repeat, _ in pairs], dtype=int)
        frame["seconds"] = np.array([seconds for _, seconds in pairs], dtype=float)
    return frame


def _load(path: Path, kind: Task) -> pd.DataFrame:
    """Read the rows of a kind, with columns for all measures and definitions of the sets."""
    statement = read_packaged("cgroup.benchmark", "sql/results.sql") + _ORDERS.get(kind, _ORDER)
    frame = _query(path, statement, (kind,))
    frame = frame.astype(dict.fromkeys(_FLOATS, float))
    parse = functools.lru_cache(maxsize=64)(json.loads)  # definitions repeat
    protocols, definitions, numbers = ([parse(text) for text in frame.pop(name)] for name in _TEXTS)
    frame["seed"] = [int(seed) for seed in frame["seed"]]  # text, if too large for SQLite
    frame["refined"] = frame["refined"].fillna(0).astype(bool)
    for name, otherwise in _MEASURES[kind].items():
        frame[name] = _make_column(name, otherwise, numbers, frame["epsilon"])
    if _MEASURES[kind] is _GROUPS:
        add_scores(frame)
        frame["translation_error_pr"] = frame["translation_error"] / frame["pr"]
    if kind == "experiment":
        return _join_experiments(frame, protocols)
    if kind in {"registration", "matches"}:
        _add_verdicts(frame, definitions)
    return frame.drop(columns=["solver", "place"])


def _make_column(name: str, otherwise: Any, rows: list[dict[str, Any]], epsilons: pd.Series) -> pd.Series:  # noqa: ANN401 - any number
    """Return a column of numbers, with counts at the threshold of each row, and NaN or infinity for None."""
    column: list[Any] = [row.get(name, otherwise) for row in rows]
    if name in {"correct", "selected_correct"}:
        column = [each.get(str(at), 0) if each else 0 for each, at in zip(column, epsilons, strict=True)]
    if isinstance(otherwise, tuple):
        column = [tuple(math.inf if each is None else each for each in row) for row in column]
    if name == "truth":
        column = [None if each is None else np.array(each) for each in column]
    dtype = type(otherwise) if isinstance(otherwise, (bool, int, float)) else object
    return pd.Series(column, dtype=dtype)


def _join_experiments(frame: pd.DataFrame, protocols: list[list[str]]) -> pd.DataFrame:
    """Join the rows of several experiments, and add verdicts by the protocols of the pairs."""
    failed = frame["error"] != ""
    counts = ["correct", "selected", "selected_correct"]
    frame[counts] = frame[counts].mask(failed) if failed.any() else frame[counts]
    add_scores(frame)
    frame["combination"] = frame.pop("matches")
    for at, name in enumerate(("detector", "descriptor")):
        frame[name] = [COMBINATIONS.get(each, ("", ""))[at] for each in frame["combination"]]
    rows = zip(frame["precision"], *(frame[name] for name in ERRORS), strict=True)
    # A group that fixes no pose is infinitely far off.
    errors = [(precision, *(each if each[0] == each[0] else [math.inf] * 3)) for precision, *each in rows]
    for protocol in dict.fromkeys(name for names in protocols for name in names if name != PAPER_PROTOCOL):
        verdicts = zip(errors, protocols, failed, strict=True)
        frame[PROTOCOL_PREFIX + protocol] = np.array(
            [
                PROTOCOLS[protocol].judge(*each) if protocol in names and not bad else None
                for each, names, bad in verdicts
            ],
            dtype=object,
        )
    keys = ["case", "solver", "epsilon"]
    ids = frame.groupby(keys, sort=False)["set"].agg(lambda each: tuple(dict.fromkeys(each)))
    order = ["dataset", "pair", "nuisance", "level", "nms_radius", "combination", "case", "place", "epsilon"]
    frame = frame.drop_duplicates(keys).sort_values(order, na_position="first", ignore_index=True)
    frame["experiments"] = [ids[key] for key in zip(*(frame[name] for name in keys), strict=True)]
    return frame.drop(columns=["solver", "place", "set"])


def _add_verdicts(frame: pd.DataFrame, definitions: list[dict[str, Any]]) -> None:
    """Add the definitions of the sets, and whether poses are within the limits; unknown errors are not."""
    for name in ("loose", "strict", "preset", "whole"):
        frame[name] = [known.get(name) for known in definitions]
    limits = {"right": ("loose", ""), "accurate": ("strict", "")}
    if "best_rmse_pr" in frame:
        limits["best_right"] = ("loose", "best_")
    for column, (limit, prefix) in limits.items():
        errors = zip(frame[limit], *(frame[prefix + name] for name in ERRORS), strict=True)
        right = [bool(PROTOCOLS[protocol].judge(math.nan, *each)) for protocol, *each in errors]
        frame[column] = np.array(right, dtype=bool)
    frame["pose"] = [None if each is None else np.frombuffer(each).reshape(4, 4) for each in frame["pose"]]
    splits = zip(frame["set"], definitions, frame["overlap"], strict=True)
    frame["column"] = [_name_column(name, known.get("split_overlap"), each) for name, known, each in splits]
    places = zip(frame["dataset"], frame["pair"], strict=True)
    recipes = [asdict(read_recipe(pair)) if name == GeneratedMatches.name else {} for name, pair in places]
    for name in ("scene", "size", "inliers", "noise", "frames", "number"):
        frame[name] = [recipe.get("n" if name == "size" else name, math.nan) for recipe in recipes]


def _name_column(name: str, split: float | None, overlap: float) -> str:
    if split is None:
        return name
    return f"{name}, overlap {'>=' if overlap >= split else '<'} {split:g}"


def _query(path: Path, statement: str, parameters: tuple[str, ...] = ()) -> pd.DataFrame:
    with open_records(path) as connection:
        cursor = connection.execute(statement, parameters)
        columns = [column[0] for column in cursor.description]
        return pd.DataFrame.from_records(cursor.fetchall(), columns=columns, coerce_float=True)


def load_skips(path: Path) -> pd.DataFrame:
    """Return the methods that were not timed on a set: `method, n, threads, reason, machine`."""
    frame = _load(path, "timing")
    frame["reason"] = frame["skipped"] + frame["error"]
    frame = frame[frame["reason"] != ""].sort_values("n", kind="stable", ignore_index=True)
    return frame[["method", "n", "threads", "reason", "machine"]]


def load_machines(path: Path) -> pd.DataFrame:
    """Return the machines of the results: `id, cpu, cores, system, python, numpy`."""
    return _query(path, "select * from machines order by id")


def load_datasets(path: Path) -> pd.DataFrame:
    """Return the facts about the data sets: `name, title, role, origin, citation`."""
    return _query(path, "select * from datasets order by name")


def load_counts(path: Path) -> dict[str, Counts]:
    """Count the results of each kind in the latest configuration."""
    with open_records(path) as connection:
        return count_results(connection)


def load_failures(path: Path) -> list[tuple[str, str, int]]:
    """Return solver, error and number of failed results, most frequent first."""
    statement = """
    select label, error, count(*) from wanted join results using (problem, solver, threads)
    where error <> '' group by label, error order by count(*) desc, label
    """
    with open_records(path) as connection:
        return connection.execute(statement).fetchall()


def load_groups(path: Path | str, case: str) -> tuple[Correspondences, FloatArray, dict[str, BoolArray]]:
    """Read the groups of all methods in one problem of an experiment.

    Parameters
    ----------
    path : path
        As for `load`.
    case : str
        Its hash, from the column `case` of `load`.

    Returns
    -------
    matches : Correspondences
        The matches of the problem.
    pose : (4,4) array of float64
        The true pose.
    masks : dict of str to (n,) array of bool
        The group of each method, by its label, in the order of the configuration.
    """
    statement = """
    select distinct l.label, mask, l.place from results r join plan_problems q using (problem)
        join plan_solvers l on l.entry = q.entry and l.solver = r.solver
    where r.problem = ? and r.error = '' and mask is not null order by l.place
    """
    with open_records(path) as connection:
        row = connection.execute("select content from matches where problem = ?", (case,)).fetchone()
        rows = connection.execute(statement, (case,)).fetchall()
    if row is None:
        raise InputError(f"{path}: no records of the case {case}; use one from the column `case` of `load`")
    try:
        found = unpack(row[0])
    except Exception as error:
        message = f"{path}: the matches of the case {case} can't be read ({error}); run it in another folder"
        raise InputError(message) from error
    assert found.truth is not None  # noqa: S101 - pairs of experiments are related
    n = len(found.matches)
    packed = ((label, np.frombuffer(mask, dtype=np.uint8)) for label, mask, _ in rows)
    masks = {label: np.unpackbits(bits, count=n).astype(bool) for label, bits in packed}
    return found.matches, found.truth, masks


def add_scores(frame: pd.DataFrame) -> None:
    """Add the columns that follow from the counts `n, correct, selected, selected_correct`."""
    counts = (frame[name].astype("float64") for name in ("n", "correct", "selected", "selected_correct"))
    for name, values in score_counts(*counts)._asdict().items():
        frame[name] = values


def aggregate(
    frame: pd.DataFrame, by: Sequence[str], how: Literal["macro", "pooled", "median"] = "macro"
) -> pd.DataFrame:
    """Return means over pairs.

    Parameters
    ----------
    frame : DataFrame
        Experiments from `load`; rows with an error are left out.
    by : sequence of str
        Columns to group by.
    how : {"macro", "pooled", "median"}
        Mean or median over the pairs with equal weights, or the scores of all matches as one set.

    Returns
    -------
    DataFrame
        The columns of `by`, the number of `pairs`, `n`, `correct`, `inlier_ratio`, `precision, recall,
        f_score`, `f_of_means` (of mean precision and recall), the shares `registered` and of each protocol
        (of the pairs to which it applies), and `seconds`. Shares are means for every `how`.

    Raises
    ------
    KeyError
        For results without a required column.

    Examples
    --------
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> from cgroup.benchmark.tables import aggregate, load
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gtm"], experiment=[small])
    >>> _ = run(config, "results", backend="threading")
    >>> means = aggregate(load("results"), ["method"])
    >>> means[["method", "pairs"]].values.tolist()
    [['gtm', 2]]
    """
    if how not in {"macro", "pooled", "median"}:
        raise InputError(f"how: got {how!r}; choose 'macro', 'pooled' or 'median'")
    protocols = [name for name in frame.columns if name.startswith(PROTOCOL_PREFIX)]
    good = frame[frame["error"] == ""].astype(dict.fromkeys(["registered", *protocols], float))
    groups = good.groupby(list(by), sort=True, dropna=False, observed=True)
    scores = ["inlier_ratio", "precision", "recall", "f_score"]
    result = groups[["n", "correct", *scores, "seconds"]].agg("median" if how == "median" else "mean")
    if how == "pooled":
        totals = groups[["n", "correct", "selected", "selected_correct"]].sum()
        add_scores(totals)
        result[scores] = totals[scores]
    result["f_of_means"] = harmonic_mean(result["precision"], result["recall"])
    result = result.join(groups[["registered", *protocols]].mean())
    result.insert(0, "pairs", groups.size())
    return result.reset_index()


def exponents(timing: pd.DataFrame, *, threads: int = 1, least: int = FITTED_FROM) -> pd.DataFrame:
    """Fit ``seconds ~ n^a`` to the median times of each method.

    Parameters
    ----------
    timing : DataFrame
        Times from `load`.
    threads : int
        Number of threads of the times.
    least : int
        Sets with fewer matches are left out.

    Returns
    -------
    DataFrame
        `method, exponent, sizes`: a, NaN for fewer than two sets, and the number of sets.

    Raises
    ------
    KeyError
        For times without a required column.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.tables import exponents
    >>> times = {"method": "gtm", "n": [2000, 4000], "threads": 1}
    >>> timing = pd.DataFrame({**times, "seconds": [0.1, 0.4]})
    >>> exponents(timing).round(6).values.tolist()
    [['gtm', 2.0, 2]]
    """
    kept = timing[(timing["threads"] == threads) & (timing["n"] >= least)]
    of_sets = kept.groupby(["method", "n"])["seconds"].median()
    medians = [(method, of_sets[method]) for method in kept["method"].unique()]
    rows = [(method, fit_exponent(list(times.index), list(times)), len(times)) for method, times in medians]
    return pd.DataFrame(rows, columns=["method", "exponent", "sizes"])
