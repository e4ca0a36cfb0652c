"""Records of the comparison of pipelines as a table."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportIndexIssue=false

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from cgroup.benchmark.records.reading import has_table, parse_json, query
from cgroup.evaluation.protocols import PROTOCOLS

if TYPE_CHECKING:
    from pathlib import Path

    import pandas as pd

_REGISTRATIONS = """
select s.id as "set", s.definition, c.dataset, c.pair, c.origin, c.kind, c.other, l.label as pipeline,
       p.name, p.refined, r.threads, r.voxel, r.pr, r.overlap, r.pose is not null as posed, r.ok,
       r.probability, r.rotation_error, r.translation_error, r.rmse as rmse_pr, r.seconds, r.error,
       r.version, r.machine
from plan_sets s join plan_pairs using (entry) join plan_pipelines l using (entry)
    join registrations r on r.case_key = plan_pairs.case_key and r.pipeline_key = l.pipeline_key
        and r.threads = s.threads
    join pair_cases c on c.key = r.case_key join pipelines p on p.key = r.pipeline_key
order by s.entry, l.place, c.dataset, c.pair, c.kind, c.other
"""


def load_registrations(path: Path) -> pd.DataFrame:
    """Read how pairs were registered, one row per pair and pipeline.

    Parameters
    ----------
    path : path
        Folder of a run, or its SQLite file. A run may be at work in it.

    Returns
    -------
    DataFrame
        `set, dataset, pair, origin`: the pair; `kind`: "related", "mirrored" (its target is), or "mixed"
        (with the target of the pair `other`); `column`: the set, with the side of `split_overlap` that the
        pair is on; `pipeline, name, refined, threads`: how; `voxel, pr, overlap`: of the pair; `ok,
        probability`: what the pipeline says of its pose; `rotation_error` (degrees), `translation_error`
        (data unit), `rmse_pr`: of its pose, NaN where there is none; `right, accurate`: whether the pose
        keeps the set's limits, false for unrelated clouds; `stages`: dict of seconds, and their sum
        `seconds`; `error`: "" or what went wrong; `version, machine`. No rows without such records.

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
    >>> len(records.load_registrations(Path("results")))  # none was asked for
    0
    """
    import pandas as pd  # noqa: PLC0415 - slow to load, and workers do without

    if not has_table(path, "registrations"):
        return pd.DataFrame()
    frame = query(path, _REGISTRATIONS)
    definitions = [parse_json(text) for text in frame.pop("definition")]
    for name in ("overlap", "probability", "rotation_error", "translation_error", "rmse_pr"):
        frame[name] = frame[name].astype(float)
    frame["ok"] = frame["ok"].astype(bool) & frame.pop("posed").astype(bool)
    frame["stages"] = [parse_json(text) for text in frame["seconds"]]
    frame["seconds"] = [sum(stages.values()) if stages else math.nan for stages in frame["stages"]]
    errors = list(zip(frame["rotation_error"], frame["translation_error"], frame["rmse_pr"], strict=True))
    for column, limit in (("right", "loose"), ("accurate", "strict")):
        frame[column] = [
            _keeps(known[limit], *of_pose) for known, of_pose in zip(definitions, errors, strict=True)
        ]
    splits = [known["split_overlap"] for known in definitions]
    frame["column"] = [_name_column(*row) for row in zip(frame["set"], splits, frame["overlap"], strict=True)]
    return frame


def _keeps(protocol: str, rotation: float, translation: float, rmse: float) -> bool:
    return bool(PROTOCOLS[protocol].judge(math.nan, rotation, translation, rmse))


def _name_column(name: str, split: float | None, overlap: float) -> str:
    if split is None:
        return name
    return f"{name}, overlap {'>=' if overlap >= split else '<'} {split:g}"
