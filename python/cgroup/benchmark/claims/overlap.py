"""Partial overlap: section 5.1, item 4."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.claims.base import LARGE, Comparison, Finding, NotTestableError
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import (
    correlate_with_levels,
    expect_at_least,
    expect_below,
    expect_in_top,
    expect_in_top_at_levels,
    measure_lead,
    name_level,
    need_levels,
    pick_levels,
)

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import ClaimEvidence

_SECTION = "5.1 item 4, overlap"
_LEADS = {0.8: 0.2, 0.9: 0.3}
_LEAD_TOLERANCE = 0.1


@claim(
    "C-21",
    section=_SECTION,
    statement="All methods get worse as the views overlap less.",
    criterion="Spearman correlation of level and F >= 0.8 for each method.",
)
def _check_falls_with_overlap(evidence: ClaimEvidence) -> Finding:
    table = evidence.need("overlap", "U3M").by_level("f_score")
    if len(table) < 3:
        message = "the records hold fewer than three levels"
        raise NotTestableError(message)
    return Finding(
        [
            expect_at_least(
                f"Spearman of F and overlap, {method.upper()}",
                correlate_with_levels(table.index, table[method]),
                0.8,
            )
            for method in table.columns
        ]
    )


@claim(
    "C-22",
    section=_SECTION,
    statement="With more than 70 % overlap, GTM is the most precise.",
    criterion="P of GTM best at each level from 0.7.",
)
def _check_gtm_most_precise(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("overlap", "U3M")
    table = pick_levels(sample.by_level("precision"), lambda level: level >= 0.7, "from 0.7")
    return Finding(expect_in_top_at_levels(sample, table, "P", {"gtm": 1}))


@claim(
    "C-23",
    section=_SECTION,
    statement="GTM is ahead in precision by about 30 points at 90 % overlap, and by about 20 at 80 %.",
    criterion="P of GTM minus the best other within 0.1 of these numbers.",
)
def _check_gtm_lead(evidence: ClaimEvidence) -> Finding:
    table = need_levels(evidence.need("overlap", "U3M").by_level("precision"), _LEADS)
    tests: list[Comparison] = []
    for level, row in table.iterrows():
        ahead = measure_lead(row, ["gtm"])
        margin = _LEAD_TOLERANCE - abs(ahead - _LEADS[float(level)])
        text = f"overlap {level:g}: lead {ahead:+.2f} (paper about {_LEADS[float(level)]:.2f})"
        tests.append(Comparison(margin >= 0, text, margin))
    return Finding(tests)


@claim(
    "C-24",
    section=_SECTION,
    statement="With less overlap, GTM and RANSAC are about equally precise.",
    criterion="P of the two differs by less than 0.1 at each level below 0.7.",
)
def _check_gtm_like_ransac(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("overlap", "U3M", "gtm", "ransac")
    table = pick_levels(sample.by_level("precision"), lambda level: level < 0.7, "below 0.7")
    return Finding(
        [
            expect_below(
                f"{name_level(sample, level)}: P of GTM {row['gtm']:.2f}, RANSAC {row['ransac']:.2f}, "
                "difference",
                float(np.abs(row["gtm"] - row["ransac"])),
                LARGE,
            )
            for level, row in table.iterrows()
        ]
    )


@claim(
    "C-25",
    section=_SECTION,
    statement="CV has the best recall at every overlap, SI the second.",
    criterion="R of CV best, and R of SI among the top two, at each level.",
)
def _check_cv_then_si(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("overlap", "U3M")
    table = sample.by_level("recall")
    return Finding(expect_in_top_at_levels(sample, table, "R", {"cv": 1, "si": 2}))


@claim(
    "C-26",
    section=_SECTION,
    statement="Weighing precision and recall together, GTM and RANSAC are preferable.",
    criterion="Each of the two among the top two by F.",
)
def _check_gtm_and_ransac_preferable(evidence: ClaimEvidence) -> Finding:
    scores = evidence.need("overlap", "U3M").overall("f_score")
    return Finding([expect_in_top(scores, method, 2, "F:") for method in ("gtm", "ransac")])
