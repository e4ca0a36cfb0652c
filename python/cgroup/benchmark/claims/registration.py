"""Rigid registration: section 5.2."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.claims.base import CLEAR, LARGE, TIE, Claim, Comparison, Finding
from cgroup.benchmark.claims.measures import (
    agreement,
    at,
    at_least,
    at_most,
    ends,
    higher,
    in_top,
    levels_where,
    named_levels,
    number,
    over,
    under,
)

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.claims.base import Records
    from cgroup.benchmark.evidence import Sample

_NOISE = "5.2 item 1, noise and density"
_SCENES = "5.2 item 2, clutter and occlusion"
_OVERLAP = "5.2 item 3, overlap"
_COUNTS = "5.2 item 4, threshold and number of matches"
_COMBINATIONS = "5.2 item 5, detector and descriptor"
_ALL = ("C1", "C2", "C3", "C4", "C5", "C6")
_HIGH_RATE = 0.9
_ABOUT_ZERO = 0.05


def _cells(sample: Sample, table: pd.DataFrame, what: str) -> list[tuple[str, float]]:
    """Label and value for each level and method."""
    return [
        (f"{at(sample, level)}, {what} of {method.upper()}", float(value))
        for level, row in table.iterrows()
        for method, value in row.items()
    ]


def _all_register(records: Records) -> Finding:
    sample = records.need("noise", "B3R")
    return Finding(
        [at_least(*cell, 1.0) for cell in _cells(sample, sample.by_level("registered"), "rate")],
    )


def _precision_above_four_tenths(records: Records) -> Finding:
    sample = records.need("noise", "B3R")
    return Finding([over(*cell, 0.4) for cell in _cells(sample, sample.by_level("precision"), "P")])


def _sparse_data(records: Records) -> Finding:
    sample = records.need("density", "B3R")
    table = sample.by_level("registered")
    dense = levels_where(table, lambda share: share > 0.3, "above 0.3 kept")
    sparse = levels_where(table, lambda share: share <= 0.3, "at or below 0.3 kept")
    tests = [at_least(*cell, 1.0) for cell in _cells(sample, dense, "rate")]
    tests += [
        under(f"lowest rate of {method.upper()} at or below 0.3 kept", float(sparse[method].min()), 1.0)
        for method in ("si", "ss")
    ]
    return Finding(tests)


def _gc_then_gtm(records: Records) -> Finding:
    rates = records.need("clutter", "U3OR").overall("registered")
    return Finding([in_top(rates, "gc", 1, "rate:"), in_top(rates, "gtm", 2, "rate:")], summary=_order(rates))


def _precise_but_fails(records: Records) -> Finding:
    more_precise: list[bool] = []
    for axis in ("clutter", "occlusion"):
        table = records.need(axis, "U3OR", "ransac", "gc").by_level("precision")
        more_precise.extend((table["ransac"] - table["gc"] > TIE).tolist())
    rates = records.need("clutter", "U3OR", "ransac", "gc").overall("registered")
    share = float(np.mean(more_precise))
    label = f"P of RANSAC higher than that of GC at {sum(more_precise)} of {len(more_precise)} levels, share"
    return Finding([over(label, share, 0.5), higher(rates, "gc", "ransac", "rate:")])


def _precision_per_pair(records: Records) -> Finding:
    rows = records.need("clutter", "U3OR", "ransac", "gc").rows
    gc = rows.loc[rows["method"] == "gc", "precision"]
    ransac = rows.loc[rows["method"] == "ransac"]
    done = ransac.loc[ransac["registered"].astype(bool), "precision"]
    failed = ransac.loc[~ransac["registered"].astype(bool), "precision"]
    return Finding(
        [
            at_most(f"GC: share of {len(gc)} pairs with P > 0.5", float((gc > 0.5).mean()), 0.1),
            at_least("GC: share of pairs with P > 0.1", float((gc > 0.1).mean()), 1.0),
            over(
                f"RANSAC: share of {len(done)} registered pairs with P > 0.5", float((done > 0.5).mean()), 0.5
            ),
            over(
                f"RANSAC: share of {len(failed)} failed pairs with P <= {_ABOUT_ZERO}",
                float((failed <= _ABOUT_ZERO).mean()),
                0.5,
            ),
        ]
    )


def _gtm_then_ransac_and_gc(records: Records) -> Finding:
    sample = records.need("overlap", "U3M")
    return Finding(
        [
            in_top(row, method, place, f"{at(sample, level)}, rate:")
            for level, row in sample.by_level("registered").iterrows()
            for method, place in (("gtm", 1), ("ransac", 3), ("gc", 3))
        ]
    )


def _most_fail(records: Records) -> Finding:
    sample = records.need("overlap", "U3M")
    table = levels_where(sample.by_level("registered"), lambda level: level < 0.6, "below 0.6")
    return Finding([under(*cell, 0.5) for cell in _cells(sample, table, "rate")])


def _threshold_hardly_matters(records: Records) -> Finding:
    sample = records.need("epsilon", "U3OR")
    table = sample.by_level("registered")
    ends(table)
    tests = [
        at_least(
            f"Kendall τ of the ranking by rate at ε {one} and {other} pr:",
            agreement(table.loc[one], table.loc[other]),
            0.8,
        )
        for one, other in zip(table.index, table.index[1:], strict=False)
    ]
    tests += [
        in_top(row, method, 2, f"{at(sample, level)}, rate:")
        for level, row in table.iterrows()
        for method in ("gc", "gtm")
    ]
    return Finding(tests)


def _rates_over_n(records: Records) -> Finding:
    place = "U3OR" if records.evidence.sample("matches", "U3OR") is not None else "U3M"
    sample = records.need("matches", place)
    table = sample.by_level("registered")
    low, high = ends(table)
    rise = table.loc[high] - table.loc[low]
    rising = float((rise > TIE).mean())
    tests = [over(f"share of methods whose rate rises from n {low:g} to {high:g}", rising, 0.5)]
    few = table[(table.index >= 250) & (table.index < 1000)]
    if len(few):
        nearest = few.index[int(np.argmin(np.abs(few.index.to_numpy(dtype=float) - 500)))]
        tests.append(in_top(few.loc[nearest], "gtm", 1, f"{at(sample, nearest)}, rate:"))
    dense = levels_where(table, lambda n: n >= 1000, "from 1000 matches")
    tests += [higher(row, "gc", "gtm", f"{at(sample, level)}, rate:") for level, row in dense.iterrows()]
    return Finding(tests)


def _stable_on_b3r(records: Records) -> Finding:
    sample = records.need("combinations", "B3R")
    table = named_levels(sample.by_level("registered"), _ALL)
    tests = [at_least(*cell, _HIGH_RATE) for cell in _cells(sample, table, "rate")]
    tests += [
        at_most(f"spread of the rate of {method.upper()}", float(np.ptp(table[method])), LARGE)
        for method in table.columns
    ]
    return Finding(tests)


def _combinations_on_scenes(records: Records) -> Finding:
    sample = records.need("combinations", "U3OR")
    table = named_levels(sample.by_level("registered"), _ALL)
    tops = [in_top(row, method, 2, name).holds for name, row in table.iterrows() for method in ("gc", "gtm")]
    behind = table.drop(columns="ss").min(axis=1) - table["ss"]
    near = [in_top(row, "nnsr", 3, name).holds for name, row in table.iterrows()]
    mean = table.mean()
    return Finding(
        [
            over("GC and GTM among the top two, share of 12 cases", float(np.mean(tops)), 0.5),
            over("SS behind the next worst by at least", float(behind.min()), CLEAR),
            Comparison(any(near), f"NNSR among the top three with {sum(near)} of 6", sum(near) - 1.0),
        ],
        summary=_order(mean),
    )


def _gtm_best_on_views(records: Records) -> Finding:
    sample = records.need("combinations", "U3M")
    table = named_levels(sample.by_level("registered"), _ALL)
    tests = [in_top(row, "gtm", 1, f"{name}, rate:") for name, row in table.iterrows()]
    peak = table["gtm"].rename(str.upper)
    tests.append(in_top(table["gtm"], "C5", 1, "rate of GTM:"))
    return Finding(
        tests, summary="GTM: " + ", ".join(f"{name} {rate:.2f}" for name, rate in peak.items()) + "."
    )


def _order(rates: pd.Series) -> str:
    ordered = rates.sort_values(ascending=False, kind="stable").items()
    return "Rates: " + ", ".join(f"{method.upper()} {number(rate)}" for method, rate in ordered) + "."


CLAIMS = (
    Claim(
        "C-43",
        _NOISE,
        "All methods register all pairs of B3R under noise.",
        "Rate 1 for each method at each level.",
        _all_register,
    ),
    Claim(
        "C-44",
        _NOISE,
        "Under noise, every method's average precision is above 0.4.",
        "P > 0.4 for each method at each level.",
        _precision_above_four_tenths,
    ),
    Claim(
        "C-45",
        _NOISE,
        "All methods register all pairs while more than 30 % of the points are kept; below, SI and SS start "
        "to fail.",
        "Rate 1 for each method at each level above 0.3; lowest rate of SI and of SS < 1 at 0.3 and below.",
        _sparse_data,
    ),
    Claim(
        "C-46",
        _SCENES,
        "In clutter and occlusion, GC registers the most pairs, GTM the second most.",
        "Rate of GC best, rate of GTM among the top two.",
        _gc_then_gtm,
    ),
    Claim(
        "C-47",
        _SCENES,
        "RANSAC is mostly more precise than GC, and yet registers fewer pairs.",
        "P of RANSAC higher at more than half of the levels; its rate lower.",
        _precise_but_fails,
    ),
    Claim(
        "C-48",
        _SCENES,
        "Pair by pair on U3OR, GC is rarely above 0.5 in precision and always above 0.1; RANSAC is usually "
        "above 0.5 where it succeeds, and near 0 where it fails.",
        "GC: P > 0.5 on at most 10 % of the pairs, P > 0.1 on all. RANSAC: P > 0.5 on more than half of the "
        "registered pairs, P <= 0.05 on more than half of the others.",
        _precision_per_pair,
    ),
    Claim(
        "C-49",
        _OVERLAP,
        "GTM registers most at every overlap, followed by RANSAC and GC.",
        "Rate of GTM best, rates of RANSAC and GC among the top three, at each level.",
        _gtm_then_ransac_and_gc,
    ),
    Claim(
        "C-50",
        _OVERLAP,
        "With less than 60 % overlap, all methods fail on most pairs.",
        "Rate < 0.5 for each method at each level below 0.6.",
        _most_fail,
    ),
    Claim(
        "C-51",
        _COUNTS,
        "The threshold hardly changes the ranking by registration; GC and GTM are the two best.",
        "Kendall τ >= 0.8 between neighbouring thresholds; GC and GTM among the top two at each.",
        _threshold_hardly_matters,
    ),
    Claim(
        "C-52",
        _COUNTS,
        "More matches raise the registration rate of most methods a little; GTM is best near 500, GC passes "
        "it for denser sets.",
        "Rate rises from the lowest to the highest n for more than half of the methods; GTM best at the "
        "level nearest 500; rate of GC higher than that of GTM at each n from 1000.",
        _rates_over_n,
    ),
    Claim(
        "C-53",
        _COMBINATIONS,
        "On B3R, all methods register reliably with every combination.",
        "Rate >= 0.9 for each method with each of the six, and within 0.1 over the six.",
        _stable_on_b3r,
    ),
    Claim(
        "C-54",
        _COMBINATIONS,
        "On U3OR, GC and GTM generally register most; SS is far behind with all combinations; NNSR is "
        "sometimes competitive.",
        "GC and GTM among the top two in more than half of the cases; SS more than 0.05 behind the next "
        "worst with each of the six; NNSR among the top three with one at least.",
        _combinations_on_scenes,
    ),
    Claim(
        "C-55",
        _COMBINATIONS,
        "On U3M, GTM registers most with every combination, and most of all with ISS and LFSH.",
        "Rate of GTM best with each of the six; its rate with C5 the best of its six.",
        _gtm_best_on_views,
    ),
)
