"""What each method selected on a few pairs of a run, drawn between their clouds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark import tables
from cgroup.benchmark.paper import PAPER_EPSILON
from cgroup.datasets import CorrespondencePair, open_dataset
from cgroup.errors import InputError
from cgroup.evaluation import correct_matches
from cgroup.plots import comparison_figure

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from cgroup.benchmark.paper.evidence import Evidence, Sample

_TYPICAL = {"B3R": "noise", "U3OR": "clutter", "U3M": "overlap"}


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


def choose_examples(evidence: Evidence) -> list[Example]:
    """Choose a case per data set of the paper: the one with the median of the methods' mean F."""
    found = (evidence.sample(experiment, place, every_method=True) for place, experiment in _TYPICAL.items())
    return [_choose_median(sample) for sample in found if sample is not None]


def draw_example(out: Path, example: Example, methods: Sequence[str], root: Path | None = None) -> Figure:
    """Draw what each method selected in a case."""
    pair = open_dataset(example.dataset, root).load(example.pair)
    if isinstance(pair, CorrespondencePair):
        message = f"{example.dataset}: has no clouds to draw"
        raise InputError(message)
    matches, pose, masks = tables.load_groups(out, example.case)
    tolerance = PAPER_EPSILON * (matches.resolution or np.nan)
    correct = correct_matches(matches.source, matches.target, pose, tolerance=tolerance)
    share = f"{int(correct.sum())} of {len(matches)} matches correct"
    return comparison_figure(
        pair.source.points,
        pair.target.points,
        matches,
        correct=correct,
        masks={method: masks[method] for method in methods if method in masks},
        T_target_source=pose,
        title=f"{example.dataset} ({example.origin}), {example.pair}: {share}",
    )


def _choose_median(sample: Sample) -> Example:
    scores = sample.rows.groupby("case")["f_score"].mean().sort_values(kind="stable")
    case = scores.index[len(scores) // 2]
    row = sample.rows[sample.rows["case"] == case].iloc[0]
    return Example(sample.place, sample.dataset, row["pair"], case, row["origin"])
