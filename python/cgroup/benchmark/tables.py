"""Results as tables of pandas: one row per problem and solver; and means over them."""

from __future__ import annotations

import functools
import json
import math
import os
import sqlite3
from contextlib import closing, contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from cgroup._checks.values import as_path
from cgroup._runtime.sqlite import is_empty
from cgroup.benchmark.problem import COMBINATIONS
from cgroup.benchmark.results import floats_from_bytes, unpack, unpack_mask
from cgroup.benchmark.store import RECORDS, RECORDS_LAYOUT, Counts, count_results, foreign_records
from cgroup.benchmark.timing import fit_exponent
from cgroup.datasets.generated_matches import GeneratedMatches, read_recipe
from cgroup.errors import InputError
from cgroup.evaluation.metrics import harmonic_mean, score_counts
from cgroup.evaluation.protocols import PAPER_PROTOCOL, PROTOCOL_PREFIX, PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence
    from pathlib import Path

    import pandas as pd

    from cgroup.benchmark.problem import Task
    from cgroup.types import BoolArray, Correspondences, FloatArray

__all__ = [
    "FITTED_FROM",
    "PairPose",
    "aggregate",
    "exponents",
    "load",
    "load_groups",
    "load_poses",
]

FITTED_FROM = 2000
"""Exponents are fitted to sets of at least so many correspondences."""

_ERRORS = ("rotation_error", "translation_error", "rmse_pr")
_BEST = tuple(f"best_{name}" for name in _ERRORS)

_EXPERIMENTS = """
select dataset, p.origin, pair, nuisance, level, p.matches as combination, nms_radius, p.front, p.facts,
       p.n, s.correct, p.pr, label as method, w.epsilon, s.selected, s.selected_correct, s.rotation_error,
       s.translation_error, s.rmse as rmse_pr, s.protocols, r.seconds, w.experiments,
       case when p.error <> '' then p.error else coalesce(r.error, '') end as error,
       coalesce(r.version, p.version) as version, seed, coalesce(r.machine, p.machine) as machine,
       w.problem as "case"
from wanted_scores w
    join problems p on p.key = w.problem
    left join results r on r.problem = w.problem and r.solver = w.solver
    left join scores s on s.problem = w.problem and s.solver = w.solver and s.epsilon = w.epsilon
where s.problem is not null or p.error <> '' or r.error <> ''
order by dataset, pair, nuisance, level, nms_radius, combination, w.problem, place, w.epsilon
"""

_RESULTS = """
select e.id as "set", e.definition, p.dataset, p.pair, p.origin, p.kind, p.other, p.matches, p.voxel,
       p.epsilon, p.n, l.label as method, s.name, s.refined, r.threads, r.seconds, r.numbers, r.skipped,
       r.error, r.version, r.machine, r.problem as "case"
from plan_sets e join plan_problems q using (entry) join plan_solvers l using (entry),
    json_each(e.threads) h
    join results r on r.problem = q.problem and r.solver = l.solver and r.threads = h.value
    join problems p on p.key = q.problem join solvers s on s.key = l.solver
where e.task = ?
order by e.entry, l.place, {order}
"""

_POSES = """
select distinct e.id, l.label, p.dataset, p.pair, r.pose, json_extract(r.numbers, '$.truth')
from plan_sets e join plan_problems q using (entry) join plan_solvers l using (entry)
    join results r on r.problem = q.problem and r.solver = l.solver join problems p on p.key = q.problem
where e.task in ('matches', 'registration') and r.error = '' and r.skipped = ''
order by e.entry, l.place, q.place
"""

_FLOATS = ("level", "nms_radius", "voxel", "seconds", *_ERRORS)
"""Columns of numbers that may all be missing."""

_NUMBERS: dict[str, dict[str, Any]] = {
    "registration": {
        **dict.fromkeys(("voxel", "pr", "overlap"), math.nan),
        "ok": False,
        "probability": math.nan,
        "nees": math.nan,
        **dict.fromkeys(_ERRORS, math.nan),
    },
    "scenes": {
        "voxel": math.nan,
        **dict.fromkeys(("scans", "right", "mixed", "found", "wanted", "placed", "tried"), 0),
    },
    "matches": {
        **dict.fromkeys(("n", "correct"), 0),
        **dict.fromkeys(("resolution", "pr", "overlap"), math.nan),
        **dict.fromkeys(("selected", "selected_correct"), 0),
        "posed": False,
        "ok": None,
        "complete": True,
        **dict.fromkeys((*_ERRORS, *_BEST), math.nan),
        "offered": 0,
        "mebibytes": math.nan,
        "diagnostics": "{}",
    },
}
"""Columns that stand in a result's JSON, with the value of a result without them."""


def load(path: Path | str, kind: Task = "experiment") -> pd.DataFrame:
    """Read the results that the latest configuration asks for.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.
    kind : {"experiment", "registration", "scenes", "matches", "timing"}
        Results of the experiments, of ways to register two clouds or many scans, of methods alone on matches,
        or of the timing.

    Returns
    -------
    DataFrame
        Of every kind: `dataset, pair`; `seconds` of the solver; `version, machine`; but for the timing
        `error`: "" or what went wrong, and then the numbers are NaN or 0; but for timing and scenes `origin`.
        No rows without such results. Errors of a pose are `rotation_error` (degrees), `translation_error`
        (data unit) and `rmse_pr`, NaN without a pose; `right, accurate` say whether they keep the set's
        limits, false for unrelated clouds.

        "experiment", one row per problem, method and threshold: `nuisance, level, combination, detector,
        descriptor, nms_radius`, with "" and NaN for fields that don't apply, `seed`, and the problem's hash
        `case`; `front`: changes of the paper's front end, as JSON with the keys of an experiment's `front`,
        "" for none; `clutter, occlusion, overlap` where they are known; `n, correct, inlier_ratio, pr`: the
        matches; `method, epsilon, selected, selected_correct, precision, recall, f_score, registered`: the
        group; errors of its pose, also `translation_error_pr`; ``ok:<protocol>``: registered by a criterion
        other than the paper's, which `registered` is, None where it isn't applicable; `experiments`: tuple of
        the ids that use the row.

        "registration", one row per pair and pipeline: `set`; `kind`: "related", "mirrored" (its target is),
        or "mixed" (with the target of the pair `other`); `column`: the set, with the side of `split_overlap`
        that the pair is on; `pipeline, name, refined, threads`; `voxel, pr, overlap`: of the pair;
        `ok, probability`: the pipeline's trust in its pose; `nees`: normalized estimation error squared, by
        the pipeline's covariance, 6 on average where that holds; errors and limits; `stages`: dict of
        seconds, of which `seconds` is the sum.

        "scenes", one row per bag of scans and solver: `set`; `dataset`: all places in the bag; `pair`: its
        seed; `kind`: "mirrored" where each place is there once more, mirrored; `solver, name, threads`;
        `voxel, scans`: of the bag; `right, mixed, found, wanted, placed` and, as tuples, `rotation,
        translation`: of `cgroup.evaluation.SceneScore`; `tried`: pairs of scans that were registered;
        `stages` as above.

        "matches", one row per problem, method and number of threads: `set, kind, other, matches, voxel,
        epsilon, case`: the problem; `loose, strict, preset, whole`: of its set, as configured; `scene, size,
        inliers, noise, frames, number`: recipe of generated ones; `method, threads`; `n, correct,
        inlier_ratio, resolution, pr, overlap`: the matches; `selected, selected_correct, precision, recall,
        f_score, registered`: the group, as above; `posed, ok, complete`: the method's word on its answer
        (`ok` is None where it gives none); errors and limits; `best_...`: the same of the best of the
        `offered` poses, by the truth; `mebibytes`; `skipped`: "" or why the method wasn't run to its end;
        `diagnostics` as JSON.

        "timing", one row per method, set and repeat: `method, n, threads` (0: all cores), `repeat`.

    Raises
    ------
    InputError
        If there are no results, or they can't be read.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> from cgroup.benchmark.tables import load
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gtm"], experiment=[small])
    >>> _ = run(config, Path("results"), backend="threading")
    >>> frame = load(Path("results"))
    >>> frame[["method", "n", "correct"]].values.tolist()
    [['gtm', 1000, 20], ['gtm', 1000, 99]]
    >>> len(load(Path("results"), "timing"))  # none was asked for
    0
    """
    makers = {
        "experiment": _make_experiments,
        "registration": _make_registrations,
        "scenes": _make_scenes,
        "matches": _make_matches,
        "timing": _make_times,
    }
    if kind not in makers:
        message = f"kind: got {kind!r}; choose one of {', '.join(makers)}"
        raise InputError(message)
    return makers[kind](as_path("path", path))


def load_skips(path: Path) -> pd.DataFrame:
    """Read which methods weren't timed on which sets: `method, n, threads, reason, machine`."""
    frame = _query_results(path, "timing").rename(columns={"skipped": "reason"})
    frame = frame[frame["reason"] != ""].sort_values("n", kind="stable").reset_index(drop=True)
    return frame[["method", "n", "threads", "reason", "machine"]]


def load_machines(path: Path) -> pd.DataFrame:
    """Read which machines made results: `id, cpu, cores, system, python, numpy`."""
    return _query(path, "select * from machines order by id")


def load_datasets(path: Path) -> pd.DataFrame:
    """Read the facts about the data sets: `name, title, role, origin, citation`."""
    return _query(path, "select * from datasets order by name")


def load_config(path: Path) -> dict[str, Any]:
    """Read the latest configuration: plain values as in its TOML, defaults filled in."""
    return _read_plan(path, "config")


def load_missing(path: Path) -> dict[str, str]:
    """Read which data sets and pipelines weren't at hand: reasons by name."""
    return _read_plan(path, "missing")


def load_counts(path: Path) -> dict[str, Counts]:
    """Read how far each stage is with the latest configuration."""
    with _open_records(path) as connection:
        return count_results(connection)


def load_failures(path: Path) -> list[tuple[str, str, int]]:
    """Read what failed, most frequent first: solver (empty where matching failed), error, how often."""
    statement = """
    select '', error, count(*) from wanted_matches join problems on key = problem
    where error <> '' group by error
    union all
    select label, error, count(*) from wanted join results using (problem, solver, threads)
    where error <> '' group by label, error
    """
    with _open_records(path) as connection:
        return sorted(connection.execute(statement).fetchall(), key=lambda row: -row[2])


def load_groups(path: Path | str, case: str) -> tuple[Correspondences, FloatArray, dict[str, BoolArray]]:
    """Read what each method selected in one problem of an experiment.

    Parameters
    ----------
    path : path
        As for `load`.
    case : str
        Its hash, from the column `case` of `load`.

    Returns
    -------
    matches : Correspondences
        The matches that the methods were given.
    pose : (4,4) array of float64
        The true pose.
    masks : dict of str to (n,) array of bool
        The group of each method, by its label, in the order of the configuration.

    Raises
    ------
    InputError
        As `load`, and if there are no results of the case.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> from cgroup.benchmark.tables import load, load_groups
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gtm"], experiment=[small])
    >>> _ = run(config, Path("results"), backend="threading")
    >>> case = load(Path("results"))["case"].iloc[0]
    >>> matches, pose, masks = load_groups(Path("results"), case)
    >>> len(matches), pose.shape, list(masks)
    (1000, (4, 4), ['gtm'])
    """
    statement = """
    select distinct l.label, mask, l.place from results r join plan_problems q using (problem)
        join plan_solvers l on l.entry = q.entry and l.solver = r.solver
    where r.problem = ? and r.error = '' and mask is not null order by l.place
    """
    with _open_records(path) as connection:
        arrays = connection.execute("select content, truth from arrays where problem = ?", (case,)).fetchone()
        rows = connection.execute(statement, (case,)).fetchall()
    if arrays is None:
        message = f"{path}: no records of the case {case}; the column `case` of `load` names those there are"
        raise InputError(message)
    try:
        matches, pose = unpack(arrays[0]), floats_from_bytes(arrays[1], (4, 4))
    except Exception as error:
        message = f"{path}: the matches of the case {case} can't be read ({error}); run it in another folder"
        raise InputError(message) from error
    return matches, pose, {label: unpack_mask(mask, len(matches)) for label, mask, _ in rows}


# --- frames ----------------------------------------------------------------------------------------


def _make_experiments(path: Path) -> pd.DataFrame:
    frame = _query(path, _EXPERIMENTS)
    frame["seed"] = [int(seed) for seed in frame["seed"]]  # text, if too large for SQLite
    combinations = [COMBINATIONS.get(name, ("", "")) for name in frame["combination"]]
    frame["detector"] = [detector for detector, _ in combinations]
    frame["descriptor"] = [descriptor for _, descriptor in combinations]
    _add_columns(frame, _parse(frame, "facts"), dict.fromkeys(("clutter", "occlusion", "overlap"), math.nan))
    frame["experiments"] = [tuple(json.loads(text)) for text in frame["experiments"]]
    verdicts = _parse(frame, "protocols")
    protocols = dict.fromkeys(name for row in verdicts for name in row if name != PAPER_PROTOCOL)
    _add_columns(frame, verdicts, protocols, PROTOCOL_PREFIX)
    add_scores(frame)
    frame["translation_error_pr"] = frame["translation_error"] / frame["pr"]
    return frame


def _make_registrations(path: Path) -> pd.DataFrame:
    frame = _query_results(path, "registration", "p.dataset, p.pair, p.kind, p.other")
    frame = frame.rename(columns={"method": "pipeline"})
    definitions, numbers = _parse(frame, "definition"), _parse(frame, "numbers")
    _add_columns(frame, numbers, _NUMBERS["registration"])
    frame["refined"] = frame["refined"].astype(bool)
    frame["stages"] = [each.get("stages", {}) for each in numbers]
    _judge_poses(frame, definitions, {"right": ("loose", ""), "accurate": ("strict", "")})
    splits = zip(frame["set"], definitions, frame["overlap"], strict=True)
    frame["column"] = [_name_column(name, known["split_overlap"], overlap) for name, known, overlap in splits]
    return frame.drop(columns=["matches", "epsilon", "n", "skipped", "case"])


def _make_scenes(path: Path) -> pd.DataFrame:
    frame = _query_results(path, "scenes").rename(columns={"method": "solver"})
    numbers = _parse(frame, "numbers")
    _add_columns(frame, numbers, _NUMBERS["scenes"])
    for name in ("rotation", "translation"):
        errors = (each.get(name, ()) for each in numbers)
        frame[name] = [tuple(math.inf if each is None else each for each in row) for row in errors]
    frame["stages"] = [each.get("stages", {}) for each in numbers]
    unused = ["definition", "origin", "other", "matches", "epsilon", "n", "refined", "skipped", "case"]
    return frame.drop(columns=unused)


def _make_matches(path: Path) -> pd.DataFrame:
    frame = _query_results(path, "matches")
    definitions = _parse(frame, "definition")
    _add_columns(frame, _parse(frame, "numbers"), _NUMBERS["matches"])
    for name in ("loose", "strict", "preset", "whole"):
        frame[name] = [known[name] for known in definitions]
    add_scores(frame)
    limits = {"right": ("loose", ""), "accurate": ("strict", ""), "best_right": ("loose", "best_")}
    _judge_poses(frame, definitions, limits)
    places = zip(frame["dataset"], frame["pair"], strict=True)
    recipes = [asdict(read_recipe(pair)) if name == GeneratedMatches.name else {} for name, pair in places]
    for name in ("scene", "size", "inliers", "noise", "frames", "number"):
        frame[name] = [recipe.get("n" if name == "size" else name, math.nan) for recipe in recipes]
    return frame.drop(columns=["name", "refined"])


def _make_times(path: Path) -> pd.DataFrame:
    frame = _query_results(path, "timing")
    frame["repeat"] = [list(enumerate(numbers["repeats"])) for numbers in _parse(frame, "numbers")]
    frame = frame[frame["skipped"] == ""].explode("repeat").sort_values("n", kind="stable")
    pairs = frame["repeat"].tolist()
    frame["repeat"] = np.array([repeat for repeat, _ in pairs], dtype=int)
    frame["seconds"] = np.array([seconds for _, seconds in pairs], dtype=float)
    columns = ["method", "n", "threads", "repeat", "seconds", "dataset", "pair", "machine", "version"]
    return frame.reset_index(drop=True)[columns]


def _parse(frame: pd.DataFrame, column: str) -> list[dict[str, Any]]:
    """Take out a column of JSON; empty where there is none."""
    parse = functools.lru_cache(maxsize=64)(json.loads)  # definitions repeat
    return [parse(text) if isinstance(text, str) else {} for text in frame.pop(column)]


def _add_columns(
    frame: pd.DataFrame, rows: list[dict[str, Any]], columns: dict[str, Any], prefix: str = ""
) -> None:
    """Add columns from JSON; each has the type of the value that stands in where there is none."""
    for name, otherwise in columns.items():
        column = [row.get(name, otherwise) for row in rows]
        dtype = object if otherwise is None or isinstance(otherwise, str) else type(otherwise)
        if dtype is float:
            column = [math.nan if each is None else each for each in column]
        frame[prefix + name] = np.array(column, dtype=dtype)


def _judge_poses(
    frame: pd.DataFrame, definitions: Sequence[dict[str, Any]], limits: dict[str, tuple[str, str]]
) -> None:
    """Add whether errors in columns with a prefix keep a limit of the set; unknown ones don't."""
    for column, (limit, prefix) in limits.items():
        errors = zip(definitions, *(frame[prefix + name] for name in _ERRORS), strict=True)
        right = [bool(PROTOCOLS[known[limit]].judge(math.nan, *each)) for known, *each in errors]
        frame[column] = np.array(right, dtype=bool)


def _name_column(name: str, split: float | None, overlap: float) -> str:
    if split is None:
        return name
    return f"{name}, overlap {'>=' if overlap >= split else '<'} {split:g}"


# --- means -----------------------------------------------------------------------------------------


def add_scores(frame: pd.DataFrame) -> None:
    """Add the columns that follow from the counts `n, correct, selected, selected_correct`."""
    counts = (frame[name].astype("float64") for name in ("n", "correct", "selected", "selected_correct"))
    for name, values in score_counts(*counts)._asdict().items():
        frame[name] = values


def aggregate(
    frame: pd.DataFrame, by: Sequence[str], how: Literal["macro", "pooled", "median"] = "macro"
) -> pd.DataFrame:
    """Take several pairs together.

    Parameters
    ----------
    frame : DataFrame
        Experiments from `load`; rows with an error are left out.
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
    KeyError
        For results that lack a column.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> from cgroup.benchmark.tables import aggregate, load
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gtm"], experiment=[small])
    >>> _ = run(config, Path("results"), backend="threading")
    >>> means = aggregate(load(Path("results")), ["method"])
    >>> means[["method", "pairs"]].values.tolist()
    [['gtm', 2]]
    """
    if how not in {"macro", "pooled", "median"}:
        message = f"how: got {how!r}; choose 'macro', 'pooled' or 'median'"
        raise InputError(message)
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
        Sets with fewer correspondences are left out.

    Returns
    -------
    DataFrame
        `method, exponent, sizes`: a, NaN for fewer than two sets, and the number of sets.

    Raises
    ------
    KeyError
        For times that lack a column.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.tables import exponents
    >>> timing = pd.DataFrame(
    ...     {"method": "gtm", "n": [2000, 4000], "threads": 1, "seconds": [0.1, 0.4]}
    ... )
    >>> exponents(timing).round(6).values.tolist()
    [['gtm', 2.0, 2]]
    """
    import pandas as pd  # noqa: PLC0415 - slow to load, and workers do without

    kept = timing[(timing["threads"] == threads) & (timing["n"] >= least)]
    of_sets = kept.groupby(["method", "n"])["seconds"].median()
    medians = [(method, of_sets[method]) for method in kept["method"].unique()]
    rows = [(method, fit_exponent(list(times.index), list(times)), len(times)) for method, times in medians]
    return pd.DataFrame(rows, columns=["method", "exponent", "sizes"])


class PairPose(NamedTuple):
    """What a method of a set has found of a pair of a data set.

    Attributes
    ----------
    set_id, method, dataset, pair : str
        Their names.
    found, true : (4,4) array of float64 or None
        Poses, which map source into target; None for none.

    Examples
    --------
    >>> from cgroup.benchmark.tables import PairPose
    >>> PairPose("KITTI", "lc", "kitti", "08/15-58", None, None).pair
    '08/15-58'
    """

    set_id: str
    method: str
    dataset: str
    pair: str
    found: FloatArray | None
    true: FloatArray | None


def load_poses(path: Path | str) -> list[PairPose]:
    """Read the poses that trials and registrations have found of pairs.

    Parameters
    ----------
    path : path
        Folder of the run, or the file of records in it.

    Returns
    -------
    list of PairPose
        By set, method and pair.

    Raises
    ------
    InputError
        If there are no records.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> from cgroup.benchmark.tables import load_poses
    >>> few = {"id": "few", "dataset": "generated-matches", "pairs": 1}
    >>> config = Config(name="mine", trials={"methods": ["lc"], "sets": [few]})
    >>> _ = run(config, Path("poses"), backend="threading")
    >>> [(one.set_id, one.method, one.found.shape) for one in load_poses(Path("poses"))]
    [('few', 'lc', (4, 4))]
    """
    with _open_records(path) as connection:
        rows = connection.execute(_POSES).fetchall()
    return [
        PairPose(
            set_id,
            method,
            dataset,
            pair,
            None if found is None else floats_from_bytes(found, (4, 4)),
            None if true is None else np.array(json.loads(true)),
        )
        for set_id, method, dataset, pair, found, true in rows
    ]


# --- the file --------------------------------------------------------------------------------------


def _query_results(path: Path, task: str, order: str = "q.place, h.value") -> pd.DataFrame:
    return _query(path, _RESULTS.format(order=order), (task,))


def _query(path: Path, statement: str, parameters: tuple[str, ...] = ()) -> pd.DataFrame:
    import pandas as pd  # noqa: PLC0415 - slow to load, and workers do without

    with _open_records(path) as connection:
        cursor = connection.execute(statement, parameters)
        columns = [column[0] for column in cursor.description]
        frame = pd.DataFrame.from_records(cursor.fetchall(), columns=columns, coerce_float=True)
    return frame.astype({name: float for name in _FLOATS if name in frame})


def _read_plan(path: Path, column: str) -> Any:  # noqa: ANN401 - whatever the column holds
    with _open_records(path) as connection:
        row = connection.execute(f"select {column} from plan").fetchone()
    if row is None:
        raise _absent(path)
    return json.loads(row[0])


@contextmanager
def _open_records(path: Path | str) -> Generator[sqlite3.Connection, None, None]:
    """Open the results for reading; a run may write to them meanwhile."""
    path = as_path("path", path)
    file = path / RECORDS if path.is_dir() else path
    if not file.exists() or not file.stat().st_size:
        raise _absent(path)
    # Also in a folder where SQLite can't make files of its own.
    alone = not os.access(file.parent, os.W_OK) and not file.with_name(file.name + "-wal").exists()
    address = f"{file.absolute().as_uri()}?mode=ro{'&immutable=1' if alone else ''}"
    try:
        with closing(sqlite3.connect(address, uri=True, timeout=30)) as connection:
            if is_empty(connection):
                raise _absent(path)
            RECORDS_LAYOUT.check(connection, foreign_records(file))
            yield connection
    except sqlite3.Error as error:
        message = (
            f"{file}: not a file of records, or one that can't be read ({error}); the next run computes all "
            "anew"
        )
        raise InputError(message) from error


def _absent(path: Path) -> InputError:
    file = path / RECORDS if path.is_dir() else path
    return InputError(f"{file}: no records; make some with: cgroup benchmark run smoke --out {path}")
