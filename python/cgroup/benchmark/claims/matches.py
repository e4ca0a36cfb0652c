"""The number of initial matches: section 5.1, item 6."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.claims.base import CLEAR, TIE, Comparison, Finding, NotTestableError
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import (
    expect_above,
    expect_below,
    expect_in_top,
    find_ends,
    name_level,
    pick_levels,
    show_score,
)

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.claims.base import ClaimEvidence
    from cgroup.benchmark.sample import Sample

_SECTION = "5.1 item 6, number of matches"
_FEW = 1000
_DENSE = (2000, 4500)  # what counts as around 3000
_VOTERS = ("si", "cv")
_FLUCTUATING = ("gc", "ransac", "3dhv")


@claim(
    "C-30",
    section=_SECTION,
    statement="With fewer than 1000 matches, SI and CV are imprecise.",
    criterion="P of both below the median of the methods at each level with n < 1000.",
)
def _check_imprecise_when_few(evidence: ClaimEvidence) -> Finding:
    sample, table = _need_by_n(evidence, "precision")
    table = pick_levels(table, lambda n: n < _FEW, "below 1000 matches")
    return Finding(
        [
            expect_below(
                f"{name_level(sample, level)}: P of {method.upper()} {show_score(row[method])}, "
                f"median of the methods {show_score(row.median())}, difference",
                row[method] - row.median(),
                0.0,
            )
            for level, row in table.iterrows()
            for method in _VOTERS
        ]
    )


@claim(
    "C-31",
    section=_SECTION,
    statement="With more than 1000 matches, the precision of SI and CV improves quickly.",
    criterion="P of both rises by more than 0.05 from about n = 1000 to the largest n.",
)
def _check_improve_quickly(evidence: ClaimEvidence) -> Finding:
    _, table = _need_by_n(evidence, "precision")
    few = table[table.index <= _FEW]
    start = few.index[-1] if len(few) else table.index[0]
    end = find_ends(table.loc[start:])[1]
    return Finding(
        [
            expect_above(
                f"P of {method.upper()} {show_score(table.loc[start, method])} at n {start:g}, "
                f"{show_score(table.loc[end, method])} at {end:g}: rise",
                table.loc[end, method] - table.loc[start, method],
                CLEAR,
            )
            for method in _VOTERS
        ]
    )


@claim(
    "C-32",
    section=_SECTION,
    statement="With about 3000 matches, CV is the second most precise.",
    criterion="P of CV among the top two at the level nearest to n = 3000 (within 2000 to 4500).",
)
def _check_cv_second_when_dense(evidence: ClaimEvidence) -> Finding:
    sample, table = _need_by_n(evidence, "precision")
    dense = pick_levels(table, lambda n: _DENSE[0] <= n <= _DENSE[1], "around 3000 matches")
    level = dense.index[int(np.argmin(np.abs(dense.index.to_numpy(dtype=float) - 3000)))]
    return Finding([expect_in_top(dense.loc[level], "cv", 2, f"{name_level(sample, level)}, P:")])


@claim(
    "C-33",
    section=_SECTION,
    statement="SI and CV recall most, clearly more than the others, for any number of matches.",
    criterion="Each among the top two by R, and both more than 0.05 above the third, at each n.",
)
def _check_voters_recall_most(evidence: ClaimEvidence) -> Finding:
    sample, table = _need_by_n(evidence, "recall")
    tests: list[Comparison] = []
    for level, row in table.iterrows():
        tests.extend(expect_in_top(row, method, 2, f"{name_level(sample, level)}, R:") for method in _VOTERS)
        gap = float(row[list(_VOTERS)].min() - row.drop(list(_VOTERS)).max())
        tests.append(expect_above(f"{name_level(sample, level)}: gap in R to the third", gap, CLEAR))
    return Finding(tests)


@claim(
    "C-34",
    section=_SECTION,
    statement="GC, RANSAC and 3DHV fluctuate as the number of matches grows.",
    criterion="F both rises and falls by more than 0.01 between neighbouring n, for each of the three.",
)
def _check_fluctuate(evidence: ClaimEvidence) -> Finding:
    _, table = _need_by_n(evidence, "f_score")
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


def _need_by_n(evidence: ClaimEvidence, column: str) -> tuple[Sample, pd.DataFrame]:
    """U3OR first, since the paper doesn't say which data it used; U3M where that is what there is."""
    try:
        sample = evidence.need("matches", "U3OR")
    except NotTestableError:
        if evidence.all.sample("matches", "U3M") is None:
            raise
        sample = evidence.need("matches", "U3M")
    return sample, sample.by_level(column)
