"""Clutter and occlusion: section 5.1, item 3."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import LARGE, TIE, Claim, Comparison, Finding
from cgroup.benchmark.claims.measures import at, in_top, lead, number, over, rank, under

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import Records

_SECTION = "5.1 item 3, clutter and occlusion"
_AXES = ("clutter", "occlusion")


def _harder_than_b3r(records: Records) -> Finding:
    easy = records.need("noise", "B3R").overall("f_score")
    hard = records.need("clutter", "U3OR").overall("f_score")
    return Finding(
        [
            Comparison(
                bool(easy[method] - hard[method] > TIE),
                f"{method.upper()} {number(easy[method])} to {number(hard[method])}",
                float(easy[method] - hard[method]),
            )
            for method in easy.index
        ],
        summary=f"Mean F over all methods {number(easy.mean())} to {number(hard.mean())}.",
    )


def _gtm_most_precise(axis: str, records: Records) -> Finding:
    sample = records.need(axis, "U3OR")
    table = sample.by_level("precision")
    gaps = [over(f"{at(sample, level)}: gap", lead(row, ["gtm"]), LARGE) for level, row in table.iterrows()]
    firsts = [in_top(row, "gtm", 1, f"{at(sample, level)}, P:") for level, row in table.iterrows()]
    return Finding([*firsts, *gaps])


def _gtm_recall_mediocre(records: Records) -> Finding:
    recall = records.need("clutter", "U3OR").overall("recall")
    place = rank(recall, "gtm")
    test = Comparison(
        3 <= place <= 7, f"R of GTM {number(recall['gtm'])}, rank {place} of {len(recall)}", 0.0
    )
    return Finding([test])


def _gtm_small_but_accurate(records: Records) -> Finding:
    sample = records.need("clutter", "U3OR")
    sizes, precision = sample.overall("selected"), sample.overall("precision")
    size_text = f"mean size of GTM's groups {sizes['gtm']:.0f}, median of the methods {sizes.median():.0f}:"
    precision_text = (
        f"P of GTM {number(precision['gtm'])}, median of the methods {number(precision.median())}:"
    )
    return Finding(
        [
            under(f"{size_text} ratio", float(sizes["gtm"] / sizes.median()), 1.0),
            over(f"{precision_text} difference", float(precision["gtm"] - precision.median()), TIE),
        ]
    )


def _cv_best_recall(records: Records) -> Finding:
    tests: list[Comparison] = []
    for axis in _AXES:
        sample = records.need(axis, "U3OR")
        for level, row in sample.by_level("recall").iterrows():
            tests.append(in_top(row, "cv", 1, f"{at(sample, level)}, R:"))
    return Finding(tests)


def _cv_lead_in_clutter(records: Records) -> Finding:
    leads = {
        axis: sum(lead(row, ["cv"]) for _, row in table.iterrows()) / len(table)
        for axis in _AXES
        for table in [records.need(axis, "U3OR").by_level("recall")]
    }
    margin = leads["clutter"] - leads["occlusion"] - TIE
    text = (
        f"mean lead of CV in R {number(leads['clutter'])} over the levels of clutter, "
        f"{number(leads['occlusion'])} over those of occlusion"
    )
    return Finding([Comparison(margin > 0, text, margin)])


def _st_falls_back(records: Records) -> Finding:
    easy = records.need("noise", "B3R").overall("f_score")
    hard = records.need("clutter", "U3OR").overall("f_score")
    low, high = rank(hard, "st"), rank(easy, "st")
    return Finding(
        [
            Comparison(low >= 5, f"F of ST on U3OR {number(hard['st'])}, rank {low}", low - 5.0),
            Comparison(high <= 2, f"F of ST on B3R {number(easy['st'])}, rank {high}", 2.0 - high),
        ]
    )


CLAIMS = (
    Claim(
        "C-13",
        _SECTION,
        "All methods do far worse on cluttered, occluded scenes than on full models.",
        "F of each method lower on U3OR than on B3R with noise.",
        _harder_than_b3r,
    ),
    Claim(
        "C-14",
        _SECTION,
        "In clutter, GTM is by far the most precise method.",
        "P of GTM best, and more than 0.1 above the second, at each level of clutter.",
        lambda records: _gtm_most_precise("clutter", records),
    ),
    Claim(
        "C-15",
        _SECTION,
        "Under occlusion, GTM is by far the most precise method.",
        "P of GTM best, and more than 0.1 above the second, at each level of occlusion.",
        lambda records: _gtm_most_precise("occlusion", records),
    ),
    Claim(
        "C-16",
        _SECTION,
        "GTM's recall is mediocre in clutter and occlusion.",
        "R of GTM has rank 3 to 7 of nine.",
        _gtm_recall_mediocre,
    ),
    Claim(
        "C-17",
        _SECTION,
        "GTM's groups are sparse but accurate.",
        "Mean size of GTM's groups below the median of the methods, its P above the median.",
        _gtm_small_but_accurate,
    ),
    Claim(
        "C-18",
        _SECTION,
        "CV has the best recall in clutter and occlusion.",
        "R of CV best at each level of both.",
        _cv_best_recall,
    ),
    Claim(
        "C-19",
        _SECTION,
        "CV's lead in recall is clearer along clutter than along occlusion.",
        "R of CV minus the best other, averaged over levels, higher for clutter.",
        _cv_lead_in_clutter,
    ),
    Claim(
        "C-20",
        _SECTION,
        "ST, which leads on B3R, does poorly on U3OR.",
        "F of ST in the lower half (rank 5 or below) on U3OR, among the top two on B3R.",
        _st_falls_back,
    ),
)
