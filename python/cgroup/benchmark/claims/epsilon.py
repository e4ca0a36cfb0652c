"""The threshold that decides what a correct match is: section 5.1, item 5."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import CLEAR, Comparison, Finding
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import (
    compare_rankings,
    expect_above,
    expect_at_least,
    expect_at_most,
    expect_in_top,
    find_ends,
)

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.claims.base import ClaimEvidence
    from cgroup.benchmark.sample import Level

_SECTION = "5.1 item 5, threshold"
_GAIN_RECALL = ("si", "cv", "ss")
_STABLE = 0.8
_ROUNDING = 1e-9


@claim(
    "C-27",
    section=_SECTION,
    statement="All methods gain precision as the threshold is relaxed.",
    criterion=(
        "No pair's P falls from one threshold to the next, for each method; so it must be, by construction."
    ),
)
def _check_precision_never_falls(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("epsilon", "U3OR")
    find_ends(sample.by_level("precision"))
    return Finding(
        [
            Comparison(
                bool(step >= -_ROUNDING),
                f"{method.upper()}: smallest step of a pair {step:+.3f}",
                float(step),
            )
            for method, step in sample.smallest_steps("precision").items()
        ]
    )


@claim(
    "C-28",
    section=_SECTION,
    statement="RANSAC and GTM gain precision fastest.",
    criterion="Each among the top two by the rise of P from the lowest to the highest threshold.",
)
def _check_steepest_rise(evidence: ClaimEvidence) -> Finding:
    rise, low, high = _measure_rise(evidence, "precision")
    return Finding(
        [
            expect_in_top(rise, method, 2, f"rise of P from ε {low} to {high} pr:")
            for method in ("ransac", "gtm")
        ]
    )


@claim(
    "C-29",
    section=_SECTION,
    statement="Only SI, CV and SS gain evidently in recall.",
    criterion="R rises by more than 0.05 for these three, by at most 0.05 for the others.",
)
def _check_recall_of_three(evidence: ClaimEvidence) -> Finding:
    rise, low, high = _measure_rise(evidence, "recall")
    tests = [
        expect_above(f"{method.upper()} rises by", rise[method], CLEAR)
        if method in _GAIN_RECALL
        else expect_at_most(f"{method.upper()} rises by", rise[method], CLEAR)
        for method in rise.index
    ]
    changes = ", ".join(f"{method.upper()} {value:+.2f}" for method, value in rise.items())
    return Finding(tests, summary=f"Change of R from ε {low} to {high} pr: {changes}.")


@claim(
    "C-29b",
    section=_SECTION,
    statement="The ranking of the methods is stable as the threshold changes.",
    criterion="Kendall τ >= 0.8 between the rankings by F at neighbouring thresholds.",
)
def _check_stable_ranking(evidence: ClaimEvidence) -> Finding:
    table = evidence.need("epsilon", "U3OR").by_level("f_score")
    find_ends(table)
    return Finding(
        [
            expect_at_least(
                f"Kendall τ of the ranking by F at ε {one} and {other} pr:",
                compare_rankings(table.loc[one], table.loc[other]),
                _STABLE,
            )
            for one, other in zip(table.index, table.index[1:], strict=False)
        ]
    )


def _measure_rise(evidence: ClaimEvidence, column: str) -> tuple[pd.Series, Level, Level]:
    table = evidence.need("epsilon", "U3OR").by_level(column)
    low, high = find_ends(table)
    return table.loc[high] - table.loc[low], low, high
