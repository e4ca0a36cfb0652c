"""Point density: section 5.1, item 2."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import Finding
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import (
    expect_above,
    expect_at_least,
    expect_higher,
    expect_in_top_at_levels,
    find_ends,
    list_cells,
    name_level,
    pick_levels,
)

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import ClaimEvidence

_SECTION = "5.1 item 2, density"


@claim(
    "C-09",
    section=_SECTION,
    statement="RANSAC and ST are the two best methods for thinned data too.",
    criterion="Each of the two among the top two by F at each level.",
)
def _check_leaders(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("density", "B3R")
    table = sample.by_level("f_score")
    return Finding(expect_in_top_at_levels(sample, table, "F", {"ransac": 2, "st": 2}))


@claim(
    "C-10",
    section=_SECTION,
    statement="GTM and CV keep a high recall as points get fewer.",
    criterion="R >= 0.9 in more than half of the cases (both methods, all levels).",
)
def _check_high_recall(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("density", "B3R", "gtm", "cv")
    cells = list_cells(sample, sample.by_level("recall")[["gtm", "cv"]], "R")
    return Finding([expect_at_least(*cell, 0.9) for cell in cells], "most")


@claim(
    "C-11",
    section=_SECTION,
    statement="With 30 % of the points or fewer, even SS is more precise than SI.",
    criterion="P of SS higher than that of SI at each level of 0.3 or less.",
)
def _check_ss_beats_si_when_sparse(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("density", "B3R", "ss", "si")
    table = pick_levels(sample.by_level("precision"), lambda share: share <= 0.3, "at or below 0.3 kept")
    return Finding(
        [
            expect_higher(row, "ss", "si", f"{name_level(sample, level)}, P:")
            for level, row in table.iterrows()
        ]
    )


@claim(
    "C-12",
    section=_SECTION,
    statement="The recall of NNSR and of SI drops dramatically for sparse data.",
    criterion="R at the highest share of points kept minus R at the lowest > 0.3, for both.",
)
def _check_recall_collapses(evidence: ClaimEvidence) -> Finding:
    table = evidence.need("density", "B3R", "nnsr", "si").by_level("recall")
    low, high = find_ends(table)
    return Finding(
        [
            expect_above(
                f"{method.upper()}: R falls from {table.loc[high, method]:.2f} ({high:g} kept) "
                f"to {table.loc[low, method]:.2f} ({low:g} kept), by",
                table.loc[high, method] - table.loc[low, method],
                0.3,
            )
            for method in ("nnsr", "si")
        ]
    )
