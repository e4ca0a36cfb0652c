"""Clutter and occlusion: section 5.1, item 3."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import LARGE, TIE, Comparison, Finding
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import (
    expect_above,
    expect_below,
    expect_in_top_at_levels,
    measure_lead,
    name_level,
    rank,
    show_score,
)

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import ClaimEvidence

_SECTION = "5.1 item 3, clutter and occlusion"
_AXES = ("clutter", "occlusion")


@claim(
    "C-13",
    section=_SECTION,
    statement="All methods do far worse on cluttered, occluded scenes than on full models.",
    criterion="F of each method lower on U3OR than on B3R with noise.",
)
def _check_harder_than_b3r(evidence: ClaimEvidence) -> Finding:
    easy = evidence.need("noise", "B3R").overall("f_score")
    hard = evidence.need("clutter", "U3OR").overall("f_score")
    return Finding(
        [
            Comparison(
                bool(easy[method] - hard[method] > TIE),
                f"{method.upper()} {show_score(easy[method])} to {show_score(hard[method])}",
                float(easy[method] - hard[method]),
            )
            for method in easy.index
        ],
        summary=f"Mean F over all methods {show_score(easy.mean())} to {show_score(hard.mean())}.",
    )


@claim(
    "C-14",
    section=_SECTION,
    statement="In clutter, GTM is by far the most precise method.",
    criterion="P of GTM best, and more than 0.1 above the second, at each level of clutter.",
)
def _check_gtm_far_ahead_in_clutter(evidence: ClaimEvidence) -> Finding:
    return _expect_gtm_far_ahead(evidence, "clutter")


@claim(
    "C-15",
    section=_SECTION,
    statement="Under occlusion, GTM is by far the most precise method.",
    criterion="P of GTM best, and more than 0.1 above the second, at each level of occlusion.",
)
def _check_gtm_far_ahead_under_occlusion(evidence: ClaimEvidence) -> Finding:
    return _expect_gtm_far_ahead(evidence, "occlusion")


@claim(
    "C-16",
    section=_SECTION,
    statement="GTM's recall is mediocre in clutter and occlusion.",
    criterion="R of GTM has rank 3 to 7 of nine.",
)
def _check_gtm_recall_mediocre(evidence: ClaimEvidence) -> Finding:
    recall = evidence.need("clutter", "U3OR").overall("recall")
    gtm_rank = rank(recall, "gtm")
    test = Comparison(
        3 <= gtm_rank <= 7, f"R of GTM {show_score(recall['gtm'])}, rank {gtm_rank} of {len(recall)}", 0.0
    )
    return Finding([test])


@claim(
    "C-17",
    section=_SECTION,
    statement="GTM's groups are sparse but accurate.",
    criterion="Mean size of GTM's groups below the median of the methods, its P above the median.",
)
def _check_gtm_small_but_accurate(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("clutter", "U3OR")
    sizes, precision = sample.overall("selected"), sample.overall("precision")
    size_text = f"mean size of GTM's groups {sizes['gtm']:.0f}, median of the methods {sizes.median():.0f}:"
    precision_text = (
        f"P of GTM {show_score(precision['gtm'])}, median of the methods {show_score(precision.median())}:"
    )
    return Finding(
        [
            expect_below(f"{size_text} ratio", float(sizes["gtm"] / sizes.median()), 1.0),
            expect_above(f"{precision_text} difference", float(precision["gtm"] - precision.median()), TIE),
        ]
    )


@claim(
    "C-18",
    section=_SECTION,
    statement="CV has the best recall in clutter and occlusion.",
    criterion="R of CV best at each level of both.",
)
def _check_cv_best_recall(evidence: ClaimEvidence) -> Finding:
    tests: list[Comparison] = []
    for axis in _AXES:
        sample = evidence.need(axis, "U3OR")
        tests += expect_in_top_at_levels(sample, sample.by_level("recall"), "R", {"cv": 1})
    return Finding(tests)


@claim(
    "C-19",
    section=_SECTION,
    statement="CV's lead in recall is clearer along clutter than along occlusion.",
    criterion="R of CV minus the best other, averaged over levels, higher for clutter.",
)
def _check_cv_lead_in_clutter(evidence: ClaimEvidence) -> Finding:
    leads = {
        axis: sum(measure_lead(row, ["cv"]) for _, row in table.iterrows()) / len(table)
        for axis in _AXES
        for table in [evidence.need(axis, "U3OR").by_level("recall")]
    }
    margin = leads["clutter"] - leads["occlusion"] - TIE
    text = (
        f"mean lead of CV in R {show_score(leads['clutter'])} over the levels of clutter, "
        f"{show_score(leads['occlusion'])} over those of occlusion"
    )
    return Finding([Comparison(margin > 0, text, margin)])


@claim(
    "C-20",
    section=_SECTION,
    statement="ST, which leads on B3R, does poorly on U3OR.",
    criterion="F of ST in the lower half (rank 5 or below) on U3OR, among the top two on B3R.",
)
def _check_st_falls_back(evidence: ClaimEvidence) -> Finding:
    easy = evidence.need("noise", "B3R").overall("f_score")
    hard = evidence.need("clutter", "U3OR").overall("f_score")
    low, high = rank(hard, "st"), rank(easy, "st")
    return Finding(
        [
            Comparison(low >= 5, f"F of ST on U3OR {show_score(hard['st'])}, rank {low}", low - 5.0),
            Comparison(high <= 2, f"F of ST on B3R {show_score(easy['st'])}, rank {high}", 2.0 - high),
        ]
    )


def _expect_gtm_far_ahead(evidence: ClaimEvidence, axis: str) -> Finding:
    sample = evidence.need(axis, "U3OR")
    table = sample.by_level("precision")
    gaps = [
        expect_above(f"{name_level(sample, level)}: gap", measure_lead(row, ["gtm"]), LARGE)
        for level, row in table.iterrows()
    ]
    return Finding([*expect_in_top_at_levels(sample, table, "P", {"gtm": 1}), *gaps])
