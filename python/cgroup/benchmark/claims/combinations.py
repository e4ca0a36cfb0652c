"""Combinations of detector and descriptor: section 5.1, item 7, and the summary of 5.1."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING

from cgroup.benchmark.claims.base import TIE, Claim, Comparison, Finding
from cgroup.benchmark.claims.measures import (
    agreement,
    at,
    at_least,
    at_most,
    in_top,
    named_levels,
    number,
    over,
)
from cgroup.benchmark.paper import EXPERIMENTS

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.claims.base import Records

_SECTION = "5.1 item 7, detector and descriptor"
_ALL = ("C1", "C2", "C3", "C4", "C5", "C6")
_WITH_LFSH = ["C2", "C5"]
_WITH_RCS = ["C3", "C6"]
_CONSISTENT = 0.6


def _lfsh_gives_few(records: Records) -> Finding:
    sample = records.need("combinations", "B3R")
    counts = named_levels(sample.matches("correct").to_frame("count"), _ALL)["count"]
    least = float(counts.drop(_WITH_LFSH).min())
    return Finding(
        [
            at_most(
                f"{name}: {counts[name]:.0f} correct matches, others {least:.0f} or more: ratio",
                counts[name] / max(least, 1e-9),
                0.5,
            )
            for name in _WITH_LFSH
        ]
    )


def _gtm_near_one(records: Records) -> Finding:
    table = _table(records, "B3R", "precision")
    tests = [at_least(f"{name}, P of GTM", row["gtm"], 0.97) for name, row in table.iterrows()]
    tests += [in_top(row, "gtm", 1, f"{name}, P:") for name, row in table.iterrows()]
    return Finding(tests)


def _three_find_nearly_all(records: Records) -> Finding:
    table = _table(records, "B3R", "recall", "cv", "gc", "ransac")
    return Finding(
        [
            at_least(f"{name}, R of {method.upper()}", row[method], 0.95)
            for name, row in table.iterrows()
            for method in ("cv", "gc", "ransac")
        ]
    )


def _best_with(combination: list[str], table: pd.DataFrame) -> list[Comparison]:
    """For each method, its best F comes with one of these combinations."""
    tests: list[Comparison] = []
    for method in table.columns:
        here = float(table.loc[combination, method].max())
        others = table[method].drop(combination)
        text = (
            f"F of {method.upper()} {number(here)} with {' or '.join(combination)}, "
            f"{number(others.max())} with {others.idxmax()}"
        )
        tests.append(Comparison(here >= others.max() - TIE, text, here - float(others.max())))
    return tests


def _best_with_rcs(records: Records) -> Finding:
    return Finding(_best_with(_WITH_RCS, _table(records, "U3OR", "f_score")))


def _ranking_holds(records: Records) -> Finding:
    f_scores = _table(records, "U3OR", "f_score")
    precision, recall = _table(records, "U3OR", "precision"), _table(records, "U3OR", "recall")
    taus = [agreement(f_scores.loc[one], f_scores.loc[other]) for one, other in combinations(_ALL, 2)]
    tests = [at_least("mean Kendall τ between the rankings by F:", sum(taus) / len(taus), _CONSISTENT)]
    tests += [in_top(row, "gtm", 1, f"{name}, P:") for name, row in precision.iterrows()]
    tests += [
        in_top(row, method, 2, f"{name}, R:") for name, row in recall.iterrows() for method in ("si", "cv")
    ]
    return Finding(tests)


def _best_with_iss_lfsh(records: Records) -> Finding:
    return Finding(_best_with(["C5"], _table(records, "U3M", "f_score")), "most")


def _order_on_views(records: Records) -> Finding:
    table = _table(records, "U3M", "f_score")
    mean = table.mean()
    tests = [in_top(mean, "gtm", 1, "mean F over the combinations:")]
    tests += [in_top(mean, method, 4, "mean F over the combinations:") for method in ("gc", "ransac", "st")]
    orders = {tuple(row[["si", "3dhv", "nnsr"]].sort_values().index) for _, row in table.iterrows()}
    text = f"SI, 3DHV and NNSR come in {len(orders)} different orders"
    tests.append(Comparison(len(orders) > 1, text, float(len(orders) - 1)))
    order = ", ".join(f"{method.upper()} {value:.2f}" for method, value in mean.sort_values()[::-1].items())
    return Finding(tests, summary=f"Order: {order}.")


def _majority_found(records: Records) -> Finding:
    for place in ("B3R", "U3OR", "U3M"):
        records.need("combinations", place, "si", "cv")
    tests: list[Comparison] = []
    for experiment in EXPERIMENTS.values():
        for place in experiment.places:
            sample = records.evidence.sample(experiment.id, place)
            if sample is None or experiment.id == "epsilon":
                continue
            table = sample.by_level("recall")
            tests.extend(
                over(f"{place}, {at(sample, level)}: R of {method.upper()}", row[method], 0.5)
                for level, row in table.iterrows()
                for method in ("si", "cv")
            )
    return Finding(tests)


def _table(records: Records, place: str, column: str, *methods: str) -> pd.DataFrame:
    return named_levels(records.need("combinations", place, *methods).by_level(column), _ALL)


CLAIMS = (
    Claim(
        "C-35",
        _SECTION,
        "On B3R, LFSH gives far fewer correct matches than the other descriptors, with either detector.",
        "Mean number of correct matches with C2, and with C5, at most half of the least of the other four.",
        _lfsh_gives_few,
    ),
    Claim(
        "C-36",
        _SECTION,
        "On B3R, GTM's precision is nearly 1 and the best, whatever the combination.",
        "P of GTM >= 0.97, and best, with each of the six.",
        _gtm_near_one,
    ),
    Claim(
        "C-37",
        _SECTION,
        "On B3R, CV, GC and RANSAC find nearly all correct matches, whatever the combination.",
        "R >= 0.95 for each of the three with each of the six.",
        _three_find_nearly_all,
    ),
    Claim(
        "C-38",
        _SECTION,
        "On U3OR, every method does best with RCS.",
        "Best F with C3 or C6, for each method.",
        _best_with_rcs,
    ),
    Claim(
        "C-39",
        _SECTION,
        "On U3OR, the ranking hardly depends on the combination: GTM leads in P, SI and CV in R.",
        "Mean Kendall τ between the rankings by F >= 0.6; P of GTM best and R of SI and CV among the top two "
        "with each of the six.",
        _ranking_holds,
    ),
    Claim(
        "C-40",
        _SECTION,
        "On U3M, most methods do best with ISS and LFSH.",
        "Best F with C5, for more than half of the methods.",
        _best_with_iss_lfsh,
    ),
    Claim(
        "C-41",
        _SECTION,
        "On U3M, GTM is best overall, followed by GC, RANSAC and ST; SI, 3DHV and NNSR swap places.",
        "By F averaged over the six, GTM first and GC, RANSAC and ST among the top four; the order of SI, "
        "3DHV and NNSR differs between combinations.",
        _order_on_views,
    ),
    Claim(
        "C-42",
        "5.1, summary",
        "SI and CV find the majority of the correct matches under all conditions.",
        "R > 0.5 for both at each level of each experiment; needs the combinations on all three data sets.",
        _majority_found,
    ),
)
