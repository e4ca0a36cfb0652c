"""What each method selected on a few pairs of a run, drawn between their clouds."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false

from __future__ import annotations

import sqlite3
from contextlib import closing
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.comparison import MethodResult
from cgroup.benchmark.packing import unpack, unpack_mask
from cgroup.benchmark.paper import PAPER_EPSILON
from cgroup.benchmark.store import RECORDS
from cgroup.datasets import CorrespondencePair, open_dataset
from cgroup.errors import InputError
from cgroup.evaluation import correct_matches, score_group
from cgroup.plots import comparison_figure
from cgroup.types import Grouping

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from cgroup.benchmark.evidence import Evidence, Sample
    from cgroup.types import BoolArray, Correspondences, FloatArray

_TYPICAL = {"B3R": "noise", "U3OR": "clutter", "U3M": "overlap"}

_MASKS = """
select distinct label, mask, place from groupings g join plan_methods m using (method_key)
    join plan_cases c on c.entry = m.entry and c.case_key = g.case_key
where g.case_key = ? and g.error = '' order by place
"""


@dataclass(frozen=True)
class Example:
    """A case worth looking at.

    Attributes
    ----------
    place : str
        Data set of the paper that it speaks for.
    dataset, pair, case : str
        Which.
    origin : str
        Where the pair comes from.
    """

    place: str
    dataset: str
    pair: str
    case: str
    origin: str


def examples(evidence: Evidence) -> list[Example]:
    """Choose a case per data set of the paper: the one with the median of the methods' mean F.

    Parameters
    ----------
    evidence : Evidence
        All records.

    Returns
    -------
    list of Example
        At most three.
    """
    found = (evidence.sample(experiment, place) for place, experiment in _TYPICAL.items())
    return [_middling(sample) for sample in found if sample is not None]


def picture(out: Path, example: Example, methods: tuple[str, ...], root: Path | None = None) -> Figure:
    """Draw what each method selected in a case.

    Parameters
    ----------
    out : path
        Folder of the run.
    example : Example
        Which case.
    methods : tuple of str
        Which methods.
    root : path, optional
        Folder with the data; the environment says by default.

    Returns
    -------
    Figure
        One panel per method; noise and the like aren't drawn.

    Raises
    ------
    InputError
        If the pair's clouds aren't at hand.
    """
    pair = open_dataset(example.dataset, root).load(example.pair)
    if isinstance(pair, CorrespondencePair):
        message = f"{example.dataset}: has no clouds to draw"
        raise InputError(message)
    matches, pose, masks = _groups(out, example.case)
    correct = correct_matches(
        matches.source, matches.target, pose, tolerance=PAPER_EPSILON * (matches.resolution or np.nan)
    )
    results = [_result(method, masks[method], correct) for method in methods if method in masks]
    share = f"{int(correct.sum())} of {len(matches)} matches correct"
    return comparison_figure(
        pair.source.points,
        pair.target.points,
        matches,
        correct=correct,
        results=results,
        T_target_source=pose,
        title=f"{example.dataset} ({example.origin}), {example.pair}: {share}",
    )


def _middling(sample: Sample) -> Example:
    scores = sample.rows.groupby("case")["f_score"].mean().sort_values(kind="stable")
    case = scores.index[len(scores) // 2]
    row = sample.rows[sample.rows["case"] == case].iloc[0]
    return Example(sample.place, sample.dataset, row["pair"], case, row["origin"])


def _groups(out: Path, case: str) -> tuple[Correspondences, FloatArray, dict[str, BoolArray]]:
    """Read the matches, the true pose, and the group of each method."""
    file = (out / RECORDS).absolute().as_uri()
    with closing(sqlite3.connect(f"{file}?mode=ro", uri=True, timeout=30)) as connection:
        content, truth = connection.execute(
            "select content, truth from arrays where case_key = ?", (case,)
        ).fetchone()
        rows = connection.execute(_MASKS, (case,)).fetchall()
    matches = unpack(content)
    pose = np.frombuffer(truth, dtype=np.float64).reshape(4, 4)
    return matches, pose, {label: unpack_mask(mask, len(matches)) for label, mask, _ in rows}


def _result(method: str, mask: BoolArray, correct: BoolArray) -> MethodResult:
    grouping = Grouping(mask, None, None, None, {})
    return MethodResult(method, grouping, score_group(mask, correct), None, np.nan, np.nan, np.nan)
