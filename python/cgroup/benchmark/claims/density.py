"""Point density: section 5.1, item 2."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import Claim, Finding
from cgroup.benchmark.claims.measures import at, at_least, ends, higher, in_top, levels_where, over

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import Records

_SECTION = "5.1 item 2, density"


def _leaders(records: Records) -> Finding:
    sample = records.need("density", "B3R")
    return Finding(
        [
            in_top(row, method, 2, f"{at(sample, level)}, F:")
            for level, row in sample.by_level("f_score").iterrows()
            for method in ("ransac", "st")
        ]
    )


def _high_recall(records: Records) -> Finding:
    sample = records.need("density", "B3R", "gtm", "cv")
    return Finding(
        [
            at_least(f"{at(sample, level)}, R of {method.upper()}", value, 0.9)
            for level, row in sample.by_level("recall")[["gtm", "cv"]].iterrows()
            for method, value in row.items()
        ],
        "most",
    )


def _ss_beats_si_when_sparse(records: Records) -> Finding:
    sample = records.need("density", "B3R", "ss", "si")
    table = levels_where(sample.by_level("precision"), lambda share: share <= 0.3, "at or below 0.3 kept")
    return Finding([higher(row, "ss", "si", f"{at(sample, level)}, P:") for level, row in table.iterrows()])


def _recall_collapses(records: Records) -> Finding:
    table = records.need("density", "B3R", "nnsr", "si").by_level("recall")
    low, high = ends(table)
    return Finding(
        [
            over(
                f"{method.upper()}: R falls from {table.loc[high, method]:.2f} ({high:g} kept) "
                f"to {table.loc[low, method]:.2f} ({low:g} kept), by",
                table.loc[high, method] - table.loc[low, method],
                0.3,
            )
            for method in ("nnsr", "si")
        ]
    )


CLAIMS = (
    Claim(
        "C-09",
        _SECTION,
        "RANSAC and ST are the two best methods for thinned data too.",
        "Each of the two among the top two by F at each level.",
        _leaders,
    ),
    Claim(
        "C-10",
        _SECTION,
        "GTM and CV keep a high recall as points get fewer.",
        "R >= 0.9 in more than half of the cases (both methods, all levels).",
        _high_recall,
    ),
    Claim(
        "C-11",
        _SECTION,
        "With 30 % of the points or fewer, even SS is more precise than SI.",
        "P of SS higher than that of SI at each level of 0.3 or less.",
        _ss_beats_si_when_sparse,
    ),
    Claim(
        "C-12",
        _SECTION,
        "The recall of NNSR and of SI drops dramatically for sparse data.",
        "R at the highest share of points kept minus R at the lowest > 0.3, for both.",
        _recall_collapses,
    ),
)
