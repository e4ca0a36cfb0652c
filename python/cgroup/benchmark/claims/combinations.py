"""Combinations of detector and descriptor: section 5.1, item 7, and the summary of 5.1."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import TIE, Comparison, Finding
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import (
    COMBINATIONS,
    compare_rankings,
    expect_above,
    expect_at_least,
    expect_at_most,
    expect_in_top,
    expect_in_top_at_levels,
    list_cells,
    name_level,
    need_levels,
    show_score,
)
from cgroup.benchmark.paper import EXPERIMENTS

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.claims.base import ClaimEvidence
    from cgroup.benchmark.sample import Sample

_SECTION = "5.1 item 7, detector and descriptor"
_WITH_LFSH = ["C2", "C5"]
_WITH_RCS = ["C3", "C6"]
_CONSISTENT = 0.6


@claim(
    "C-35",
    section=_SECTION,
    statement=(
        "On B3R, LFSH gives far fewer correct matches than the other descriptors, with either detector."
    ),
    criterion=(
        "Mean number of correct matches with C2, and with C5, at most half of the least of the other four."
    ),
)
def _check_lfsh_gives_few(evidence: ClaimEvidence) -> Finding:
    sample = evidence.need("combinations", "B3R")
    counts = need_levels(sample.matches("correct").to_frame("count"), COMBINATIONS)["count"]
    least = float(counts.drop(_WITH_LFSH).min())
    return Finding(
        [
            expect_at_most(
                f"{name}: {counts[name]:.0f} correct matches, others {least:.0f} or more: ratio",
                counts[name] / max(least, 1e-9),
                0.5,
            )
            for name in _WITH_LFSH
        ]
    )


@claim(
    "C-36",
    section=_SECTION,
    statement="On B3R, GTM's precision is nearly 1 and the best, whatever the combination.",
    criterion="P of GTM >= 0.97, and best, with each of the six.",
)
def _check_gtm_near_one(evidence: ClaimEvidence) -> Finding:
    sample, table = _need_table(evidence, "B3R", "precision")
    tests = [expect_at_least(*cell, 0.97) for cell in list_cells(sample, table[["gtm"]], "P")]
    return Finding([*tests, *expect_in_top_at_levels(sample, table, "P", {"gtm": 1})])


@claim(
    "C-37",
    section=_SECTION,
    statement="On B3R, CV, GC and RANSAC find nearly all correct matches, whatever the combination.",
    criterion="R >= 0.95 for each of the three with each of the six.",
)
def _check_three_find_nearly_all(evidence: ClaimEvidence) -> Finding:
    methods = ["cv", "gc", "ransac"]
    sample, table = _need_table(evidence, "B3R", "recall", *methods)
    return Finding([expect_at_least(*cell, 0.95) for cell in list_cells(sample, table[methods], "R")])


@claim(
    "C-38",
    section=_SECTION,
    statement="On U3OR, every method does best with RCS.",
    criterion="Best F with C3 or C6, for each method.",
)
def _check_best_with_rcs(evidence: ClaimEvidence) -> Finding:
    _, table = _need_table(evidence, "U3OR", "f_score")
    return Finding(_expect_best_with(_WITH_RCS, table))


@claim(
    "C-39",
    section=_SECTION,
    statement="On U3OR, the ranking hardly depends on the combination: GTM leads in P, SI and CV in R.",
    criterion=(
        "Mean Kendall τ between the rankings by F >= 0.6; P of GTM best and R of SI and CV among the top two "
        "with each of the six."
    ),
)
def _check_ranking_holds(evidence: ClaimEvidence) -> Finding:
    sample, f_scores = _need_table(evidence, "U3OR", "f_score")
    _, precision = _need_table(evidence, "U3OR", "precision")
    _, recall = _need_table(evidence, "U3OR", "recall")
    taus = [
        compare_rankings(f_scores.loc[one], f_scores.loc[other])
        for one, other in combinations(COMBINATIONS, 2)
    ]
    tests = [expect_at_least("mean Kendall τ between the rankings by F:", sum(taus) / len(taus), _CONSISTENT)]
    tests += expect_in_top_at_levels(sample, precision, "P", {"gtm": 1})
    tests += expect_in_top_at_levels(sample, recall, "R", {"si": 2, "cv": 2})
    return Finding(tests)


@claim(
    "C-40",
    section=_SECTION,
    statement="On U3M, most methods do best with ISS and LFSH.",
    criterion="Best F with C5, for more than half of the methods.",
)
def _check_best_with_iss_lfsh(evidence: ClaimEvidence) -> Finding:
    _, table = _need_table(evidence, "U3M", "f_score")
    return Finding(_expect_best_with(["C5"], table), "most")


@claim(
    "C-41",
    section=_SECTION,
    statement="On U3M, GTM is best overall, followed by GC, RANSAC and ST; SI, 3DHV and NNSR swap places.",
    criterion=(
        "By F averaged over the six, GTM first and GC, RANSAC and ST among the top four; the order of SI, "
        "3DHV and NNSR differs between combinations."
    ),
)
def _check_order_on_views(evidence: ClaimEvidence) -> Finding:
    _, table = _need_table(evidence, "U3M", "f_score")
    mean = table.mean()
    tests = [
        expect_in_top(mean, method, k, "mean F over the combinations:")
        for method, k in {"gtm": 1, "gc": 4, "ransac": 4, "st": 4}.items()
    ]
    orders = {tuple(row[["si", "3dhv", "nnsr"]].sort_values().index) for _, row in table.iterrows()}
    text = f"SI, 3DHV and NNSR come in {len(orders)} different orders"
    tests.append(Comparison(len(orders) > 1, text, float(len(orders) - 1)))
    order = ", ".join(f"{method.upper()} {value:.2f}" for method, value in mean.sort_values()[::-1].items())
    return Finding(tests, summary=f"Order: {order}.")


@claim(
    "C-42",
    section="5.1, summary",
    statement="SI and CV find the majority of the correct matches under all conditions.",
    criterion=(
        "R > 0.5 for both at each level of each experiment; needs the combinations on all three data sets."
    ),
)
def _check_majority_found(evidence: ClaimEvidence) -> Finding:
    for place in ("B3R", "U3OR", "U3M"):
        evidence.need("combinations", place, "si", "cv")
    tests: list[Comparison] = []
    for experiment in EXPERIMENTS.values():
        for place in experiment.places:
            sample = evidence.all.sample(experiment.id, place)
            if sample is None or experiment.id == "epsilon":
                continue
            recall = sample.by_level("recall").reindex(columns=["si", "cv"])
            for level, row in recall.iterrows():
                label = f"{place}, {name_level(sample, level)}: R of"
                tests += [expect_above(f"{label} {each.upper()}", row[each], 0.5) for each in ("si", "cv")]
    return Finding(tests)


def _expect_best_with(combination: list[str], table: pd.DataFrame) -> list[Comparison]:
    """For each method, its best F comes with one of these combinations."""
    tests: list[Comparison] = []
    for method in table.columns:
        here = float(table.loc[combination, method].max())
        others = table[method].drop(combination).dropna()
        if others.empty:
            continue
        text = (
            f"F of {method.upper()} {show_score(here)} with {' or '.join(combination)}, "
            f"{show_score(others.max())} with {others.idxmax()}"
        )
        tests.append(Comparison(here >= others.max() - TIE, text, here - float(others.max())))
    return tests


def _need_table(
    evidence: ClaimEvidence, place: str, column: str, *methods: str
) -> tuple[Sample, pd.DataFrame]:
    sample = evidence.need("combinations", place, *methods)
    return sample, need_levels(sample.by_level(column), COMBINATIONS)
