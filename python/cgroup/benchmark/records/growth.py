"""How the time of a method grows with the number of correspondences."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    import pandas as pd

FITTED_FROM = 2000
"""Exponents are fitted to sets of at least so many correspondences."""


def fit_exponent(n: Sequence[float], seconds: Sequence[float]) -> float:
    """Exponent a of ``seconds ~ n^a``, by least squares in logarithms.

    Parameters
    ----------
    n, seconds : sequence of float
        Sizes and times.

    Returns
    -------
    float
        NaN for fewer than two different sizes.
    """
    if len(set(n)) < 2:
        return float("nan")
    return float(np.polyfit(np.log(n), np.log(seconds), 1)[0])


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

    Raises
    ------
    KeyError
        For times that lack a column.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.records import exponents
    >>> timing = pd.DataFrame(
    ...     {"method": "gtm", "n": [2000, 4000], "threads": 1, "seconds": [0.1, 0.4]}
    ... )
    >>> exponents(timing).round(6).values.tolist()
    [['gtm', 2.0, 2]]
    """
    import pandas as pd  # noqa: PLC0415 - slow to load, and workers do without

    kept = timing[(timing["threads"] == threads) & (timing["n"] >= least)]
    rows: list[dict[str, Any]] = []
    of_sets = kept.groupby(["method", "n"])["seconds"].median()
    for method in kept["method"].unique():
        medians = of_sets[method]
        exponent = fit_exponent(list(medians.index), list(medians))
        rows.append({"method": method, "exponent": exponent, "sizes": len(medians)})
    return pd.DataFrame(rows, columns=["method", "exponent", "sizes"])
