"""The number of initial matches: section 5.1, item 6."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.claims.base import CLEAR, TIE, Claim, Comparison, Finding, NotTestableError
from cgroup.benchmark.claims.measures import at, ends, in_top, levels_where, number, over, under

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.claims.base import Records
    from cgroup.benchmark.evidence import Sample

_SECTION = "5.1 item 6, number of matches"
_FEW = 1000
_DENSE = (2000, 4500)  # what counts as around 3000
_VOTERS = ("si", "cv")
_FLUCTUATING = ("gc", "ransac", "3dhv")


def _imprecise_when_few(records: Records) -> Finding:
    sample, table = _by_n(records, "precision")
    table = levels_where(table, lambda n: n < _FEW, "below 1000 matches")
    return Finding(
        [
            under(
                f"{at(sample, level)}: P of {method.upper()} {number(row[method])}, "
                f"median of the methods {number(row.median())}, difference",
                row[method] - row.median(),
                0.0,
            )
            for level, row in table.iterrows()
            for method in _VOTERS
        ]
    )


def _improve_quickly(records: Records) -> Finding:
    _, table = _by_n(records, "precision")
    few = table[table.index <= _FEW]
    start = few.index[-1] if len(few) else table.index[0]
    end = ends(table.loc[start:])[1]
    return Finding(
        [
            over(
                f"P of {method.upper()} {number(table.loc[start, method])} at n {start:g}, "
                f"{number(table.loc[end, method])} at {end:g}: rise",
                table.loc[end, method] - table.loc[start, method],
                CLEAR,
            )
            for method in _VOTERS
        ]
    )


def _cv_second_when_dense(records: Records) -> Finding:
    sample, table = _by_n(records, "precision")
    dense = levels_where(table, lambda n: _DENSE[0] <= n <= _DENSE[1], "around 3000 matches")
    level = dense.index[int(np.argmin(np.abs(dense.index.to_numpy(dtype=float) - 3000)))]
    return Finding([in_top(dense.loc[level], "cv", 2, f"{at(sample, level)}, P:")])


def _voters_recall_most(records: Records) -> Finding:
    sample, table = _by_n(records, "recall")
    tests: list[Comparison] = []
    for level, row in table.iterrows():
        tests.extend(in_top(row, method, 2, f"{at(sample, level)}, R:") for method in _VOTERS)
        gap = float(row[list(_VOTERS)].min() - row.drop(list(_VOTERS)).max())
        tests.append(over(f"{at(sample, level)}: gap in R to the third", gap, CLEAR))
    return Finding(tests)


def _fluctuate(records: Records) -> Finding:
    _, table = _by_n(records, "f_score")
    if len(table) < 3:
        message = "the records hold fewer than three numbers of matches"
        raise NotTestableError(message)
    tests: list[Comparison] = []
    for method in _FLUCTUATING:
        steps = np.diff(table[method].to_numpy())
        smaller = min(float(steps.max()), float(-steps.min()))
        values = ", ".join(f"{value:.2f}" for value in table[method])
        tests.append(Comparison(smaller > TIE, f"F of {method.upper()} {values}", smaller - TIE))
    return Finding(tests, summary="n: " + ", ".join(f"{n:g}" for n in table.index) + ".")


def _by_n(records: Records, column: str) -> tuple[Sample, pd.DataFrame]:
    """U3OR first, since the paper doesn't say which data it used; U3M where that is what there is."""
    try:
        sample = records.need("matches", "U3OR")
    except NotTestableError:
        if records.evidence.sample("matches", "U3M") is None:
            raise
        sample = records.need("matches", "U3M")
    return sample, sample.by_level(column)


CLAIMS = (
    Claim(
        "C-30",
        _SECTION,
        "With fewer than 1000 matches, SI and CV are imprecise.",
        "P of both below the median of the methods at each level with n < 1000.",
        _imprecise_when_few,
    ),
    Claim(
        "C-31",
        _SECTION,
        "With more than 1000 matches, the precision of SI and CV improves quickly.",
        "P of both rises by more than 0.05 from about n = 1000 to the largest n.",
        _improve_quickly,
    ),
    Claim(
        "C-32",
        _SECTION,
        "With about 3000 matches, CV is the second most precise.",
        "P of CV among the top two at the level nearest to n = 3000 (within 2000 to 4500).",
        _cv_second_when_dense,
    ),
    Claim(
        "C-33",
        _SECTION,
        "SI and CV recall most, clearly more than the others, for any number of matches.",
        "Each among the top two by R, and both more than 0.05 above the third, at each n.",
        _voters_recall_most,
    ),
    Claim(
        "C-34",
        _SECTION,
        "GC, RANSAC and 3DHV fluctuate as the number of matches grows.",
        "F both rises and falls by more than 0.01 between neighbouring n, for each of the three.",
        _fluctuate,
    ),
)
