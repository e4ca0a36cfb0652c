"""Gaussian noise: section 5.1, item 1."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import TIE, Claim, Comparison, Finding
from cgroup.benchmark.claims.measures import (
    at,
    at_least,
    ends,
    higher,
    in_top,
    lead,
    levels_where,
    number,
    rising,
)

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import Records

_SECTION = "5.1 item 1, noise"
_LEADERS = ("ransac", "st")


def _acceptable_below_two_tenths(records: Records) -> Finding:
    sample = records.need("noise", "B3R")
    table = levels_where(sample.by_level("precision"), lambda level: level < 0.2, "below 0.2 pr")
    return Finding(
        [
            at_least(f"{at(sample, level)}, P of {method.upper()}", value, 0.4)
            for level, row in table.iterrows()
            for method, value in row.items()
        ]
    )


def _leaders_below_two_tenths(records: Records) -> Finding:
    sample = records.need("noise", "B3R")
    table = levels_where(sample.by_level("f_score"), lambda level: level < 0.2, "below 0.2 pr")
    return Finding(
        [
            in_top(row, method, 2, f"{at(sample, level)}, F:")
            for level, row in table.iterrows()
            for method in _LEADERS
        ]
    )


def _lead_grows(records: Records) -> Finding:
    table = records.need("noise", "B3R").by_level("f_score")
    low, high = ends(table)
    leads = [lead(row, _LEADERS) for _, row in table.iterrows()]
    margin = leads[-1] - leads[0] - TIE
    text = f"lead in F {number(leads[0])} at noise of {low} pr, {number(leads[-1])} at {high} pr"
    summary = f"Spearman of lead and noise over all levels: {rising(range(len(leads)), leads):.2f}."
    return Finding([Comparison(margin > 0, text, margin)], summary=summary)


def _ratio_beats_clusters(records: Records) -> Finding:
    sample = records.need("noise", "B3R", "nnsr", "gc", "3dhv")
    return Finding(
        [
            higher(row, "nnsr", other, f"{at(sample, level)}, P:")
            for level, row in sample.by_level("precision").iterrows()
            for other in ("gc", "3dhv")
        ]
    )


def _recall_stays_high(records: Records) -> Finding:
    methods = ["st", "ransac", "gc", "gtm", "cv"]
    sample = records.need("noise", "B3R", *methods)
    return Finding(
        [
            at_least(f"{at(sample, level)}, R of {method.upper()}", value, 0.9)
            for level, row in sample.by_level("recall")[methods].iterrows()
            for method, value in row.items()
        ]
    )


def _si_drops_most(records: Records) -> Finding:
    table = records.need("noise", "B3R").by_level("f_score")
    low, high = ends(table)
    drops = table.loc[low] - table.loc[high]
    return Finding([in_top(drops, "si", 1, f"drop in F from noise of {low} to {high} pr:")])


CLAIMS = (
    Claim(
        "C-03",
        _SECTION,
        "With noise below 0.2 pr, all nine methods do acceptably.",
        "P >= 0.4 for each method at each level below 0.2 pr.",
        _acceptable_below_two_tenths,
    ),
    Claim(
        "C-04",
        _SECTION,
        "With noise below 0.2 pr, RANSAC and ST are the two best methods.",
        "Each of the two among the top two by F at each level below 0.2 pr.",
        _leaders_below_two_tenths,
    ),
    Claim(
        "C-05",
        _SECTION,
        "The more noise, the further RANSAC and ST are ahead of the rest.",
        "Mean F of the two minus the best other F grows from the lowest to the highest level.",
        _lead_grows,
    ),
    Claim(
        "C-06",
        _SECTION,
        "NNSR selects with higher precision than GC and than 3DHV.",
        "P of NNSR higher than that of each of the two at each level.",
        _ratio_beats_clusters,
    ),
    Claim(
        "C-07",
        _SECTION,
        "ST, RANSAC, GC, GTM and CV find nearly all correct matches at every noise level.",
        "R >= 0.9 for each of the five at each level.",
        _recall_stays_high,
    ),
    Claim(
        "C-08",
        _SECTION,
        "SI suffers most from severe noise.",
        "Largest drop in F of all methods from the lowest to the highest level.",
        _si_drops_most,
    ),
)
