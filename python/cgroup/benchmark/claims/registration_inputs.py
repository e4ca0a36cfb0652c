"""Rigid registration by threshold, number of matches, detector and descriptor: section 5.2, items 4 and 5."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.claims.base import CLEAR, LARGE, TIE, Comparison, Finding
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import (
    COMBINATIONS,
    compare_rankings,
    expect_above,
    expect_at_least,
    expect_at_most,
    expect_higher,
    expect_in_top,
    expect_in_top_at_levels,
    find_ends,
    list_cells,
    name_level,
    need_levels,
    pick_levels,
    show_order,
)

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import ClaimEvidence

_COUNTS = "5.2 item 4, threshold and number of matches"
_COMBINATIONS = "5.2 item 5, detector and descriptor"
_HIGH_RATE = 0.9


@claim(
    "C-51",
    section=_COUNTS,
    statement="The threshold hardly changes the ranking by registration; GC and GTM are the two best.",
    criterion="Kendall τ >= 0.8 between neighbouring thresholds; GC and GTM among the top two at each.",
)
def _check_threshold_hardly_matters(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("epsilon", "U3OR")
    table = sample.by_level("registered")
    find_ends(table)
    tests = [
        expect_at_least(
            f"Kendall τ of the ranking by rate at ε {one} and {other} pr:",
            compare_rankings(table.loc[one], table.loc[other]),
            0.8,
        )
        for one, other in zip(table.index, table.index[1:], strict=False)
    ]
    return Finding([*tests, *expect_in_top_at_levels(sample, table, "rate", {"gc": 2, "gtm": 2})])


@claim(
    "C-52",
    section=_COUNTS,
    statement=(
        "More matches raise the registration rate of most methods a little; GTM is best near 500, GC passes "
        "it for denser sets."
    ),
    criterion=(
        "Rate rises from the lowest to the highest n for more than half of the methods; GTM best at the "
        "level nearest 500; rate of GC higher than that of GTM at each n from 1000."
    ),
)
def _check_rates_over_n(evidence: ClaimEvidence) -> Finding:
    place = "U3OR" if evidence.all.sample("matches", "U3OR") is not None else "U3M"
    sample = evidence.need("matches", place)
    table = sample.by_level("registered")
    low, high = find_ends(table)
    rise = table.loc[high] - table.loc[low]
    rising = float((rise > TIE).mean())
    tests = [expect_above(f"share of methods whose rate rises from n {low:g} to {high:g}", rising, 0.5)]
    few = table[(table.index >= 250) & (table.index < 1000)]
    if len(few):
        nearest = few.index[int(np.argmin(np.abs(few.index.to_numpy(dtype=float) - 500)))]
        tests.append(expect_in_top(few.loc[nearest], "gtm", 1, f"{name_level(sample, nearest)}, rate:"))
    dense = pick_levels(table, lambda n: n >= 1000, "from 1000 matches")
    tests += [
        expect_higher(row, "gc", "gtm", f"{name_level(sample, level)}, rate:")
        for level, row in dense.iterrows()
    ]
    return Finding(tests)


@claim(
    "C-53",
    section=_COMBINATIONS,
    statement="On B3R, all methods register reliably with every combination.",
    criterion="Rate >= 0.9 for each method with each of the six, and within 0.1 over the six.",
)
def _check_stable_on_b3r(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("combinations", "B3R")
    table = need_levels(sample.by_level("registered"), COMBINATIONS)
    tests = [expect_at_least(*cell, _HIGH_RATE) for cell in list_cells(sample, table, "rate")]
    tests += [
        expect_at_most(f"spread of the rate of {method.upper()}", float(np.ptp(table[method])), LARGE)
        for method in table.columns
    ]
    return Finding(tests)


@claim(
    "C-54",
    section=_COMBINATIONS,
    statement=(
        "On U3OR, GC and GTM generally register most; SS is far behind with all combinations; NNSR is "
        "sometimes competitive."
    ),
    criterion=(
        "GC and GTM among the top two in more than half of the cases; SS more than 0.05 behind the next "
        "worst with each of the six; NNSR among the top three with one at least."
    ),
)
def _check_combinations_on_scenes(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("combinations", "U3OR")
    table = need_levels(sample.by_level("registered"), COMBINATIONS)
    tops = [each.holds for each in expect_in_top_at_levels(sample, table, "rate", {"gc": 2, "gtm": 2})]
    near = [each.holds for each in expect_in_top_at_levels(sample, table, "rate", {"nnsr": 3})]
    behind = table.drop(columns="ss").min(axis=1) - table["ss"]
    return Finding(
        [
            expect_above("GC and GTM among the top two, share of 12 cases", float(np.mean(tops)), 0.5),
            expect_above("SS behind the next worst by at least", float(behind.min()), CLEAR),
            Comparison(any(near), f"NNSR among the top three with {sum(near)} of 6", sum(near) - 1.0),
        ],
        summary=show_order(table.mean()),
    )


@claim(
    "C-55",
    section=_COMBINATIONS,
    statement="On U3M, GTM registers most with every combination, and most of all with ISS and LFSH.",
    criterion="Rate of GTM best with each of the six; its rate with C5 the best of its six.",
)
def _check_gtm_best_on_views(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("combinations", "U3M")
    table = need_levels(sample.by_level("registered"), COMBINATIONS)
    tests = expect_in_top_at_levels(sample, table, "rate", {"gtm": 1})
    tests.append(expect_in_top(table["gtm"], "C5", 1, "rate of GTM:"))
    rates = ", ".join(f"{name} {rate:.2f}" for name, rate in table["gtm"].items())
    return Finding(tests, summary=f"GTM: {rates}.")
