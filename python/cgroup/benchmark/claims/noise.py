"""Gaussian noise: section 5.1, item 1."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import TIE, Comparison, Finding
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import (
    correlate_with_levels,
    expect_at_least,
    expect_higher,
    expect_in_top,
    expect_in_top_at_levels,
    find_ends,
    list_cells,
    measure_lead,
    name_level,
    pick_levels,
    show_score,
)

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import ClaimEvidence

_SECTION = "5.1 item 1, noise"
_LEADERS = ("ransac", "st")


@claim(
    "C-03",
    section=_SECTION,
    statement="With noise below 0.2 pr, all nine methods do acceptably.",
    criterion="P >= 0.4 for each method at each level below 0.2 pr.",
)
def _check_acceptable_below_two_tenths(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("noise", "B3R")
    table = pick_levels(sample.by_level("precision"), lambda level: level < 0.2, "below 0.2 pr")
    return Finding([expect_at_least(*cell, 0.4) for cell in list_cells(sample, table, "P")])


@claim(
    "C-04",
    section=_SECTION,
    statement="With noise below 0.2 pr, RANSAC and ST are the two best methods.",
    criterion="Each of the two among the top two by F at each level below 0.2 pr.",
)
def _check_leaders_below_two_tenths(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("noise", "B3R")
    table = pick_levels(sample.by_level("f_score"), lambda level: level < 0.2, "below 0.2 pr")
    return Finding(expect_in_top_at_levels(sample, table, "F", dict.fromkeys(_LEADERS, 2)))


@claim(
    "C-05",
    section=_SECTION,
    statement="The more noise, the further RANSAC and ST are ahead of the rest.",
    criterion="Mean F of the two minus the best other F grows from the lowest to the highest level.",
)
def _check_lead_grows(evidence: ClaimEvidence) -> Finding:
    table = evidence.need("noise", "B3R").by_level("f_score")
    low, high = find_ends(table)
    leads = [measure_lead(row, _LEADERS) for _, row in table.iterrows()]
    margin = leads[-1] - leads[0] - TIE
    text = f"lead in F {show_score(leads[0])} at noise of {low} pr, {show_score(leads[-1])} at {high} pr"
    growth = correlate_with_levels(range(len(leads)), leads)
    summary = f"Spearman of lead and noise over all levels: {growth:.2f}."
    return Finding([Comparison(margin > 0, text, margin)], summary=summary)


@claim(
    "C-06",
    section=_SECTION,
    statement="NNSR selects with higher precision than GC and than 3DHV.",
    criterion="P of NNSR higher than that of each of the two at each level.",
)
def _check_ratio_beats_clusters(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("noise", "B3R", "nnsr", "gc", "3dhv")
    return Finding(
        [
            expect_higher(row, "nnsr", other, f"{name_level(sample, level)}, P:")
            for level, row in sample.by_level("precision").iterrows()
            for other in ("gc", "3dhv")
        ]
    )


@claim(
    "C-07",
    section=_SECTION,
    statement="ST, RANSAC, GC, GTM and CV find nearly all correct matches at every noise level.",
    criterion="R >= 0.9 for each of the five at each level.",
)
def _check_recall_stays_high(evidence: ClaimEvidence) -> Finding:
    methods = ["st", "ransac", "gc", "gtm", "cv"]
    sample = evidence.need("noise", "B3R", *methods)
    cells = list_cells(sample, sample.by_level("recall")[methods], "R")
    return Finding([expect_at_least(*cell, 0.9) for cell in cells])


@claim(
    "C-08",
    section=_SECTION,
    statement="SI suffers most from severe noise.",
    criterion="Largest drop in F of all methods from the lowest to the highest level.",
)
def _check_si_drops_most(evidence: ClaimEvidence) -> Finding:
    table = evidence.need("noise", "B3R").by_level("f_score")
    low, high = find_ends(table)
    drops = table.loc[low] - table.loc[high]
    return Finding([expect_in_top(drops, "si", 1, f"drop in F from noise of {low} to {high} pr:")])
