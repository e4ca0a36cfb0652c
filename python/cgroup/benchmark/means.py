"""Means of results over pairs, and growth of times with the number of matches."""

from collections.abc import Sequence
from typing import Literal

import pandas as pd

from cgroup.benchmark.solving import fit_exponent
from cgroup.errors import InputError
from cgroup.evaluation.metrics import harmonic_mean, score_counts
from cgroup.evaluation.protocols import PROTOCOL_PREFIX

FITTED_FROM = 2000  # exponents are fitted to sets of at least this many matches


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
