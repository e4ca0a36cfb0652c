"""Scores of records, and their means over pairs."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup.errors import InputError
from cgroup.evaluation.metrics import harmonic_mean, score_counts
from cgroup.evaluation.protocols import PROTOCOL_PREFIX

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd


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
    KeyError
        For a frame that lacks a column.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark import records
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.run import run
    >>> small = {"id": "small", "dataset": "generated-matches", "pairs": 2}
    >>> config = Config(name="mine", methods=["gtm"], experiment=[small])
    >>> _ = run(config, Path("results"), backend="threading")
    >>> means = records.aggregate(records.load(Path("results")), ["method"])
    >>> means[["method", "pairs"]].values.tolist()
    [['gtm', 2]]
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
        add_scores(totals)
        for name in ("inlier_ratio", "precision", "recall", "f_score"):
            result[name] = totals[name]
    result["f_of_means"] = harmonic_mean(result["precision"], result["recall"])
    shares = groups[["registered", *protocols]].mean()
    result = result.join(shares)
    result.insert(0, "pairs", groups.size())
    return result.reset_index()
