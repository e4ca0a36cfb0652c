"""Records of the comparison of grouping methods as a table."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportIndexIssue=false

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.records.means import add_scores
from cgroup.benchmark.records.reading import has_table, parse_json, query
from cgroup.datasets.generated_matches import GeneratedMatches, read_recipe
from cgroup.evaluation.protocols import PROTOCOLS

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd

_TRIALS = """
select s.id as "set", s.definition, c.dataset, c.pair, c.origin, c.kind, c.other, c.matches, c.voxel,
       c.epsilon, l.label as method, t.threads, t.n, t.correct, t.resolution, t.pr, t.overlap, t.selected,
       t.selected_correct, t.posed, t.ok, t.complete, t.rotation_error, t.translation_error,
       t.rmse as rmse_pr, t.best_rotation_error, t.best_translation_error, t.best_rmse as best_rmse_pr,
       t.offered, t.seconds, t.mebibytes, t.diagnostics, t.skipped, t.error, t.version, t.machine,
       t.case_key as "case"
from plan_trials s join plan_problems p using (entry) join plan_candidates l using (entry)
    join plan_threads h using (entry)
    join trials t on t.case_key = p.case_key and t.method_key = l.method_key and t.threads = h.threads
    join problems c on c.key = t.case_key
order by s.entry, l.place, p.place, h.threads
"""

_NUMBERS = (
    *("voxel", "resolution", "pr", "overlap", "seconds", "mebibytes"),
    *("rotation_error", "translation_error", "rmse_pr"),
    *("best_rotation_error", "best_translation_error", "best_rmse_pr"),
)


def load_trials(path: Path) -> pd.DataFrame:
    """Read how methods grouped problems, one row per problem, method and threads.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    DataFrame
        `set, dataset, pair, origin, matches, voxel, epsilon, case`: the problem; `kind`: "related",
        "mirrored" (the target is), or "mixed" (with the target of the pair `other`); `loose, strict, preset,
        whole`: of its set, as configured; `scene, size, inliers, noise, frames, number`: what generated ones
        are drawn from; `method, threads`: how; `n, correct, inlier_ratio, resolution, pr, overlap`: the
        matches; `selected, selected_correct, precision, recall, f_score`: the group; `posed, ok, complete`:
        what the method says of its answer (`ok` is None where it doesn't); `rotation_error` (degrees),
        `translation_error` (data unit), `rmse_pr`: of its pose, NaN where there is none; `right, accurate`:
        whether that keeps the limits of the set, and `registered` whether precision exceeds 0.1, the paper's
        criterion; `best_...` and `best_right`: the same of the best of the `offered` poses, by the truth;
        `seconds, mebibytes`; `skipped`: "" or why the method wasn't run to its end; `error`: "" or what went
        wrong; `version, machine`. Whatever was skipped or went wrong has scores of 0. No rows without such
        records.

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
    >>> easy = {"id": "easy", "grid": {"n": 200, "inliers": 0.3, "repeats": 2}}
    >>> config = Config(name="mine", methods=["gtm"], trials={"sets": [easy]})
    >>> _ = run(config, Path("results"))
    >>> trials = records.load_trials(Path("results"))
    >>> trials[["set", "method", "n", "right"]].values.tolist()
    [['easy', 'gtm', 200, True], ['easy', 'gtm', 200, True]]
    """
    import pandas as pd  # noqa: PLC0415 - slow to load, and workers do without

    if not has_table(path, "trials"):
        return pd.DataFrame()
    frame = query(path, _TRIALS)
    definitions = [parse_json(text) for text in frame.pop("definition")]
    for name in _NUMBERS:
        frame[name] = frame[name].astype(float)
    for name in ("posed", "complete"):
        frame[name] = frame[name].astype(bool)
    for name in ("loose", "strict", "preset", "whole"):
        frame[name] = [known[name] for known in definitions]
    frame["ok"] = np.array(
        [None if math.isnan(v) else bool(v) for v in frame["ok"].astype(float)], dtype=object
    )
    add_scores(frame)
    for column, limit, prefix in (
        ("right", "loose", ""),
        ("accurate", "strict", ""),
        ("best_right", "loose", "best_"),
    ):
        errors = zip(
            *(frame[prefix + name] for name in ("rotation_error", "translation_error", "rmse_pr")),
            strict=True,
        )
        frame[column] = [_keeps(known[limit], *each) for known, each in zip(definitions, errors, strict=True)]
    return _add_recipes(frame)


def _add_recipes(frame: pd.DataFrame) -> pd.DataFrame:
    """Add what generated problems are drawn from."""
    import pandas as pd  # noqa: PLC0415 - as above

    generated = frame["dataset"] == GeneratedMatches.name
    recipes = pd.DataFrame(
        [asdict(read_recipe(pair)) for pair in frame.loc[generated, "pair"]], index=frame.index[generated]
    )
    recipes = recipes.rename(columns={"n": "size"})
    for name in ("scene", "size", "inliers", "noise", "frames", "number"):
        frame[name] = recipes.get(name, np.nan)
    return frame


def _keeps(protocol: str, rotation: float, translation: float, rmse: float) -> bool:
    """Whether errors keep limits; not where they aren't known."""
    return bool(PROTOCOLS[protocol].judge(math.nan, rotation, translation, rmse))
