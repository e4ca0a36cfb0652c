"""Rigid registration under each nuisance: section 5.2, items 1 to 3."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.claims.base import TIE, Finding
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import (
    expect_above,
    expect_at_least,
    expect_at_most,
    expect_below,
    expect_higher,
    expect_in_top,
    expect_in_top_at_levels,
    list_cells,
    pick_levels,
    show_order,
)

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import ClaimEvidence

_NOISE = "5.2 item 1, noise and density"
_SCENES = "5.2 item 2, clutter and occlusion"
_OVERLAP = "5.2 item 3, overlap"
_ABOUT_ZERO = 0.05


@claim(
    "C-43",
    section=_NOISE,
    statement="All methods register all pairs of B3R under noise.",
    criterion="Rate 1 for each method at each level.",
)
def _check_all_register(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("noise", "B3R")
    return Finding(
        [expect_at_least(*cell, 1.0) for cell in list_cells(sample, sample.by_level("registered"), "rate")],
    )


@claim(
    "C-44",
    section=_NOISE,
    statement="Under noise, every method's average precision is above 0.4.",
    criterion="P > 0.4 for each method at each level.",
)
def _check_precision_above_four_tenths(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("noise", "B3R")
    return Finding(
        [expect_above(*cell, 0.4) for cell in list_cells(sample, sample.by_level("precision"), "P")]
    )


@claim(
    "C-45",
    section=_NOISE,
    statement=(
        "All methods register all pairs while more than 30 % of the points are kept; below, SI and SS start "
        "to fail."
    ),
    criterion=(
        "Rate 1 for each method at each level above 0.3; lowest rate of SI and of SS < 1 at 0.3 and below."
    ),
)
def _check_sparse_data(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("density", "B3R")
    table = sample.by_level("registered")
    dense = pick_levels(table, lambda share: share > 0.3, "above 0.3 kept")
    sparse = pick_levels(table, lambda share: share <= 0.3, "at or below 0.3 kept")
    tests = [expect_at_least(*cell, 1.0) for cell in list_cells(sample, dense, "rate")]
    tests += [
        expect_below(
            f"lowest rate of {method.upper()} at or below 0.3 kept", float(sparse[method].min()), 1.0
        )
        for method in ("si", "ss")
    ]
    return Finding(tests)


@claim(
    "C-46",
    section=_SCENES,
    statement="In clutter and occlusion, GC registers the most pairs, GTM the second most.",
    criterion="Rate of GC best, rate of GTM among the top two.",
)
def _check_gc_then_gtm(evidence: ClaimEvidence) -> Finding:
    rates = evidence.need("clutter", "U3OR").overall("registered")
    return Finding(
        [expect_in_top(rates, "gc", 1, "rate:"), expect_in_top(rates, "gtm", 2, "rate:")],
        summary=show_order(rates),
    )


@claim(
    "C-47",
    section=_SCENES,
    statement="RANSAC is mostly more precise than GC, and yet registers fewer pairs.",
    criterion="P of RANSAC higher at more than half of the levels; its rate lower.",
)
def _check_precise_but_fails(evidence: ClaimEvidence) -> Finding:
    more_precise: list[bool] = []
    for axis in ("clutter", "occlusion"):
        table = evidence.need(axis, "U3OR", "ransac", "gc").by_level("precision")
        more_precise.extend((table["ransac"] - table["gc"] > TIE).tolist())
    rates = evidence.need("clutter", "U3OR", "ransac", "gc").overall("registered")
    share = float(np.mean(more_precise))
    label = f"P of RANSAC higher than that of GC at {sum(more_precise)} of {len(more_precise)} levels, share"
    return Finding([expect_above(label, share, 0.5), expect_higher(rates, "gc", "ransac", "rate:")])


@claim(
    "C-48",
    section=_SCENES,
    statement=(
        "Pair by pair on U3OR, GC is rarely above 0.5 in precision and always above 0.1; RANSAC is usually "
        "above 0.5 where it succeeds, and near 0 where it fails."
    ),
    criterion=(
        "GC: P > 0.5 on at most 10 % of the pairs, P > 0.1 on all. RANSAC: P > 0.5 on more than half of the "
        "registered pairs, P <= 0.05 on more than half of the others."
    ),
)
def _check_precision_per_pair(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("clutter", "U3OR", "ransac", "gc")
    precision, registered = sample.rows["precision"], sample.rows["registered"].astype(bool)
    gc, ransac = (sample.rows["method"] == method for method in ("gc", "ransac"))
    done, failed = ransac & registered, ransac & ~registered
    return Finding(
        [
            expect_at_most(
                f"GC: share of {sample.count(gc)} pairs with P > 0.5", sample.share(precision > 0.5, gc), 0.1
            ),
            expect_at_least("GC: share of pairs with P > 0.1", sample.share(precision > 0.1, gc), 1.0),
            expect_above(
                f"RANSAC: share of {sample.count(done)} registered pairs with P > 0.5",
                sample.share(precision > 0.5, done),
                0.5,
            ),
            expect_above(
                f"RANSAC: share of {sample.count(failed)} failed pairs with P <= {_ABOUT_ZERO}",
                sample.share(precision <= _ABOUT_ZERO, failed),
                0.5,
            ),
        ]
    )


@claim(
    "C-49",
    section=_OVERLAP,
    statement="GTM registers most at every overlap, followed by RANSAC and GC.",
    criterion="Rate of GTM best, rates of RANSAC and GC among the top three, at each level.",
)
def _check_gtm_then_ransac_and_gc(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("overlap", "U3M")
    table = sample.by_level("registered")
    return Finding(expect_in_top_at_levels(sample, table, "rate", {"gtm": 1, "ransac": 3, "gc": 3}))


@claim(
    "C-50",
    section=_OVERLAP,
    statement="With less than 60 % overlap, all methods fail on most pairs.",
    criterion="Rate < 0.5 for each method at each level below 0.6.",
)
def _check_most_fail(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("overlap", "U3M")
    table = pick_levels(sample.by_level("registered"), lambda level: level < 0.6, "below 0.6")
    return Finding([expect_below(*cell, 0.5) for cell in list_cells(sample, table, "rate")])
