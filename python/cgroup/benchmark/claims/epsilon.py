"""The threshold that decides what a correct match is: section 5.1, item 5."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import CLEAR, Claim, Comparison, Finding
from cgroup.benchmark.claims.measures import agreement, at_least, at_most, ends, in_top, over

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.claims.base import Records
    from cgroup.benchmark.evidence import Level

_SECTION = "5.1 item 5, threshold"
_GAIN_RECALL = ("si", "cv", "ss")
_STABLE = 0.8
_ROUNDING = 1e-9


def _precision_never_falls(records: Records) -> Finding:
    sample = records.need("epsilon", "U3OR")
    ends(sample.by_level("precision"))
    ordered = sample.rows.sort_values("x")
    steps = ordered.groupby(["method", "pair"])["precision"].diff()
    worst = steps.groupby(ordered["method"]).min()
    return Finding(
        [
            Comparison(
                bool(step >= -_ROUNDING),
                f"{method.upper()}: smallest step of a pair {step:+.3f}",
                float(step),
            )
            for method, step in worst.items()
        ]
    )


def _steepest_rise(records: Records) -> Finding:
    rise, low, high = _rise(records, "precision")
    return Finding(
        [in_top(rise, method, 2, f"rise of P from ε {low} to {high} pr:") for method in ("ransac", "gtm")]
    )


def _recall_of_three(records: Records) -> Finding:
    rise, low, high = _rise(records, "recall")
    tests = [
        over(f"{method.upper()} rises by", rise[method], CLEAR)
        if method in _GAIN_RECALL
        else at_most(f"{method.upper()} rises by", rise[method], CLEAR)
        for method in rise.index
    ]
    changes = ", ".join(f"{method.upper()} {value:+.2f}" for method, value in rise.items())
    return Finding(tests, summary=f"Change of R from ε {low} to {high} pr: {changes}.")


def _stable_ranking(records: Records) -> Finding:
    table = records.need("epsilon", "U3OR").by_level("f_score")
    ends(table)
    return Finding(
        [
            at_least(
                f"Kendall τ of the ranking by F at ε {one} and {other} pr:",
                agreement(table.loc[one], table.loc[other]),
                _STABLE,
            )
            for one, other in zip(table.index, table.index[1:], strict=False)
        ]
    )


def _rise(records: Records, column: str) -> tuple[pd.Series, Level, Level]:
    table = records.need("epsilon", "U3OR").by_level(column)
    low, high = ends(table)
    return table.loc[high] - table.loc[low], low, high


CLAIMS = (
    Claim(
        "C-27",
        _SECTION,
        "All methods gain precision as the threshold is relaxed.",
        "No pair's P falls from one threshold to the next, for each method; so it must be, by construction.",
        _precision_never_falls,
    ),
    Claim(
        "C-28",
        _SECTION,
        "RANSAC and GTM gain precision fastest.",
        "Each among the top two by the rise of P from the lowest to the highest threshold.",
        _steepest_rise,
    ),
    Claim(
        "C-29",
        _SECTION,
        "Only SI, CV and SS gain evidently in recall.",
        "R rises by more than 0.05 for these three, by at most 0.05 for the others.",
        _recall_of_three,
    ),
    Claim(
        "C-29b",
        _SECTION,
        "The ranking of the methods is stable as the threshold changes.",
        "Kendall τ >= 0.8 between the rankings by F at neighbouring thresholds.",
        _stable_ranking,
    ),
)
