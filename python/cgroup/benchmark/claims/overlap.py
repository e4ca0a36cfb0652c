"""Partial overlap: section 5.1, item 4."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.claims.base import LARGE, Claim, Comparison, Finding, NotTestableError
from cgroup.benchmark.claims.measures import (
    at,
    at_least,
    in_top,
    lead,
    levels_where,
    named_levels,
    rising,
    under,
)

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import Records

_SECTION = "5.1 item 4, overlap"
_LEADS = {0.8: 0.2, 0.9: 0.3}
_LEAD_TOLERANCE = 0.1


def _falls_with_overlap(records: Records) -> Finding:
    table = records.need("overlap", "U3M").by_level("f_score")
    if len(table) < 3:
        message = "the records hold fewer than three levels"
        raise NotTestableError(message)
    return Finding(
        [
            at_least(f"Spearman of F and overlap, {method.upper()}", rising(table.index, table[method]), 0.8)
            for method in table.columns
        ]
    )


def _gtm_most_precise(records: Records) -> Finding:
    sample = records.need("overlap", "U3M")
    table = levels_where(sample.by_level("precision"), lambda level: level >= 0.7, "from 0.7")
    return Finding([in_top(row, "gtm", 1, f"{at(sample, level)}, P:") for level, row in table.iterrows()])


def _gtm_lead(records: Records) -> Finding:
    table = named_levels(records.need("overlap", "U3M").by_level("precision"), _LEADS)
    tests: list[Comparison] = []
    for level, row in table.iterrows():
        ahead = lead(row, ["gtm"])
        margin = _LEAD_TOLERANCE - abs(ahead - _LEADS[float(level)])
        text = f"overlap {level:g}: lead {ahead:+.2f} (paper about {_LEADS[float(level)]:.2f})"
        tests.append(Comparison(margin >= 0, text, margin))
    return Finding(tests)


def _gtm_like_ransac(records: Records) -> Finding:
    sample = records.need("overlap", "U3M", "gtm", "ransac")
    table = levels_where(sample.by_level("precision"), lambda level: level < 0.7, "below 0.7")
    return Finding(
        [
            under(
                f"{at(sample, level)}: P of GTM {row['gtm']:.2f}, RANSAC {row['ransac']:.2f}, difference",
                float(np.abs(row["gtm"] - row["ransac"])),
                LARGE,
            )
            for level, row in table.iterrows()
        ]
    )


def _cv_then_si(records: Records) -> Finding:
    sample = records.need("overlap", "U3M")
    return Finding(
        [
            in_top(row, method, place, f"{at(sample, level)}, R:")
            for level, row in sample.by_level("recall").iterrows()
            for place, method in ((1, "cv"), (2, "si"))
        ]
    )


def _gtm_and_ransac_preferable(records: Records) -> Finding:
    scores = records.need("overlap", "U3M").overall("f_score")
    return Finding([in_top(scores, method, 2, "F:") for method in ("gtm", "ransac")])


CLAIMS = (
    Claim(
        "C-21",
        _SECTION,
        "All methods get worse as the views overlap less.",
        "Spearman correlation of level and F >= 0.8 for each method.",
        _falls_with_overlap,
    ),
    Claim(
        "C-22",
        _SECTION,
        "With more than 70 % overlap, GTM is the most precise.",
        "P of GTM best at each level from 0.7.",
        _gtm_most_precise,
    ),
    Claim(
        "C-23",
        _SECTION,
        "GTM is ahead in precision by about 30 points at 90 % overlap, and by about 20 at 80 %.",
        "P of GTM minus the best other within 0.1 of these numbers.",
        _gtm_lead,
    ),
    Claim(
        "C-24",
        _SECTION,
        "With less overlap, GTM and RANSAC are about equally precise.",
        "P of the two differs by less than 0.1 at each level below 0.7.",
        _gtm_like_ransac,
    ),
    Claim(
        "C-25",
        _SECTION,
        "CV has the best recall at every overlap, SI the second.",
        "R of CV best, and R of SI among the top two, at each level.",
        _cv_then_si,
    ),
    Claim(
        "C-26",
        _SECTION,
        "Weighing precision and recall together, GTM and RANSAC are preferable.",
        "Each of the two among the top two by F.",
        _gtm_and_ransac_preferable,
    ),
)
