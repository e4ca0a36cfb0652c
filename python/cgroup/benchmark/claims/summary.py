"""Visual results and summary: sections 5.4 and 6."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.claims.base import TIE, TIME_TIE, Claim, Comparison, Finding
from cgroup.benchmark.claims.efficiency import SLOWEST
from cgroup.benchmark.claims.measures import at_least, duration, higher, in_top, number, under

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.claims.base import Records

_SUMMARY = "6, summary"
_GROUP_BASED = ["ransac", "st", "gc", "3dhv", "gtm"]
_INDIVIDUAL = ["ss", "nnsr", "si", "cv"]
_VOTERS = ["si", "cv"]
_EXPERIMENT = {"B3R": "noise", "U3OR": "clutter", "U3M": "overlap"}
_HARD = ("U3OR", "U3M")
_CHAINED = ("gc+ransac", "gtm+ransac")


def _baselines_keep_outliers(records: Records) -> Finding:
    tests: list[Comparison] = []
    for place in _EXPERIMENT:
        precision = _scores(records, place, "precision", "ss", "nnsr")
        for method in ("ss", "nnsr"):
            compare = under if place in _HARD else at_least
            tests.append(compare(f"{place}: P of {method.upper()}", float(precision[method]), 0.5))
    return Finding(tests)


def _gc_by_inlier_ratio(records: Records) -> Finding:
    easy = _scores(records, "B3R", "precision")
    better = int((easy.drop("gc") > easy["gc"] + TIE).sum())
    text = f"B3R: {better} of {len(easy) - 1} others more precise than GC ({number(easy['gc'])})"
    tests = [Comparison(better > (len(easy) - 1) / 2, text, better - (len(easy) - 1) / 2)]
    tests += [in_top(_scores(records, place, "registered"), "gc", 3, f"{place}, rate:") for place in _HARD]
    return Finding(tests)


def _groups_precise_voters_complete(records: Records) -> Finding:
    tests: list[Comparison] = []
    for place in _EXPERIMENT:
        precision, recall = _scores(records, place, "precision"), _scores(records, place, "recall")
        tests += [
            _means_differ(
                f"{place}: mean P", precision, ("group-based", _GROUP_BASED), ("others", _INDIVIDUAL)
            ),
            _means_differ(f"{place}: mean R", recall, ("SI and CV", _VOTERS), ("group-based", _GROUP_BASED)),
        ]
    return Finding(tests)


def _means_differ(
    label: str, scores: pd.Series, one: tuple[str, list[str]], other: tuple[str, list[str]]
) -> Comparison:
    (name, methods), (other_name, others) = one, other
    first, second = float(scores[methods].mean()), float(scores[others].mean())
    text = f"{label} {number(first)} ({name}), {number(second)} ({other_name})"
    return Comparison(first - second > TIE, text, first - second - TIE)


def _cv_beats_si(records: Records) -> Finding:
    tests = [
        higher(_scores(records, place, "precision", "cv", "si"), "cv", "si", f"{place}, P:")
        for place in _EXPERIMENT
    ]
    times = np.log(records.need_times("cv", "si"))
    tests += [
        higher(row, "si", "cv", f"n {n}, time:", by=TIME_TIE, show=duration) for n, row in times.iterrows()
    ]
    return Finding(tests)


def _grouping_first(records: Records) -> Finding:
    tests: list[Comparison] = []
    for place in _HARD:
        rates = records.need_same_cases(place, *_CHAINED, "ransac").overall("registered")
        tests += [higher(rates, method, "ransac", f"{place}, rate:") for method in _CHAINED]
    return Finding(tests)


def _scores(records: Records, place: str, column: str, *methods: str) -> pd.Series:
    return records.need(_EXPERIMENT[place], place, *methods).overall(column)


CLAIMS = (
    Claim(
        "C-62",
        "5.4, visualization",
        "What SS and NNSR select contains many outliers, except on B3R.",
        "P of both below 0.5 on U3OR and U3M, at least 0.5 on B3R.",
        _baselines_keep_outliers,
    ),
    SLOWEST,
    Claim(
        "C-64",
        _SUMMARY,
        "GC is inferior to most methods where many initial matches are correct, and good where few are.",
        "P on B3R below that of more than half of the others; rate among the top three on U3OR and on U3M.",
        _gc_by_inlier_ratio,
    ),
    Claim(
        "C-65",
        _SUMMARY,
        "Group-based methods are more precise; SI and CV recall more.",
        "Mean P of the five group-based methods higher than that of the four others; mean R of SI and CV "
        "higher than that of the five; on each of the three data sets.",
        _groups_precise_voters_complete,
    ),
    Claim(
        "C-66",
        _SUMMARY,
        "CV is more precise than SI, and faster.",
        "P of CV higher on each of the three data sets; its time lower at each n.",
        _cv_beats_si,
    ),
    Claim(
        "C-67",
        _SUMMARY,
        "Grouping by GC or GTM before the pose is estimated registers far more pairs than RANSAC on "
        "the raw matches.",
        "Rate of RANSAC on the group of GC, and on that of GTM, higher than on all matches, on U3OR and U3M.",
        _grouping_first,
    ),
)
