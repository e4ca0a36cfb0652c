"""Visual results and summary: sections 5.4 and 6."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.claims.base import TIE, TIME_TIE, Comparison, Finding, NotTestableError
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import (
    expect_at_least,
    expect_below,
    expect_higher,
    expect_in_top,
    show_score,
    show_time,
)

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.claims.base import ClaimEvidence

_SUMMARY = "6, summary"
_GROUP_BASED = ("ransac", "st", "gc", "3dhv", "gtm")
_INDIVIDUAL = ("ss", "nnsr", "si", "cv")
_VOTERS = ("si", "cv")
_NAMES = {_GROUP_BASED: "group-based", _INDIVIDUAL: "others", _VOTERS: "SI and CV"}
_EXPERIMENT = {"B3R": "noise", "U3OR": "clutter", "U3M": "overlap"}
_HARD = ("U3OR", "U3M")
_LARGE_N = 3000
_CHAINED = ("gc+ransac", "gtm+ransac")


@claim(
    "C-62",
    section="5.4, visualization",
    statement="What SS and NNSR select contains many outliers, except on B3R.",
    criterion="P of both below 0.5 on U3OR and U3M, at least 0.5 on B3R.",
)
def _check_baselines_keep_outliers(evidence: ClaimEvidence) -> Finding:
    tests: list[Comparison] = []
    for place in _EXPERIMENT:
        precision = _need_scores(evidence, place, "precision", "ss", "nnsr")
        for method in ("ss", "nnsr"):
            expect = expect_below if place in _HARD else expect_at_least
            tests.append(expect(f"{place}: P of {method.upper()}", float(precision[method]), 0.5))
    return Finding(tests)


@claim(
    "C-63",
    section=_SUMMARY,
    statement="ST takes the longest of all for large sets.",
    criterion="Slowest at the largest n, which has to be 3000 or more.",
)
def _check_st_slowest_when_large(evidence: ClaimEvidence) -> Finding:
    times = np.log(evidence.need_times())
    if times.index[-1] < _LARGE_N:
        message = f"no times for n of {_LARGE_N} or more"
        raise NotTestableError(message)
    label = f"n {times.index[-1]}, slowest:"
    return Finding([expect_in_top(times.iloc[-1], "st", 1, label, tie=TIME_TIE, show=show_time)])


@claim(
    "C-64",
    section=_SUMMARY,
    statement=(
        "GC is inferior to most methods where many initial matches are correct, and good where few are."
    ),
    criterion=(
        "P on B3R below that of more than half of the others; rate among the top three on U3OR and on U3M."
    ),
)
def _check_gc_by_inlier_ratio(evidence: ClaimEvidence) -> Finding:
    easy = _need_scores(evidence, "B3R", "precision")
    better = int((easy.drop("gc") > easy["gc"] + TIE).sum())
    text = f"B3R: {better} of {len(easy) - 1} others more precise than GC ({show_score(easy['gc'])})"
    tests = [Comparison(better > (len(easy) - 1) / 2, text, better - (len(easy) - 1) / 2)]
    tests += [
        expect_in_top(_need_scores(evidence, place, "registered"), "gc", 3, f"{place}, rate:")
        for place in _HARD
    ]
    return Finding(tests)


@claim(
    "C-65",
    section=_SUMMARY,
    statement="Group-based methods are more precise; SI and CV recall more.",
    criterion=(
        "Mean P of the five group-based methods higher than that of the four others; mean R of SI and CV "
        "higher than that of the five; on each of the three data sets."
    ),
)
def _check_groups_precise_voters_complete(evidence: ClaimEvidence) -> Finding:
    tests: list[Comparison] = []
    for place in _EXPERIMENT:
        precision = _need_scores(evidence, place, "precision")
        recall = _need_scores(evidence, place, "recall")
        tests += [
            _expect_higher_mean(f"{place}: mean P", precision, _GROUP_BASED, _INDIVIDUAL),
            _expect_higher_mean(f"{place}: mean R", recall, _VOTERS, _GROUP_BASED),
        ]
    return Finding(tests)


@claim(
    "C-66",
    section=_SUMMARY,
    statement="CV is more precise than SI, and faster.",
    criterion="P of CV higher on each of the three data sets; its time lower at each n.",
)
def _check_cv_beats_si(evidence: ClaimEvidence) -> Finding:
    tests = [
        expect_higher(_need_scores(evidence, place, "precision", "cv", "si"), "cv", "si", f"{place}, P:")
        for place in _EXPERIMENT
    ]
    times = np.log(evidence.need_times("cv", "si"))
    tests += [
        expect_higher(row, "si", "cv", f"n {n}, time:", by=TIME_TIE, show=show_time)
        for n, row in times.iterrows()
    ]
    return Finding(tests)


@claim(
    "C-67",
    section=_SUMMARY,
    statement=(
        "Grouping by GC or GTM before the pose is estimated registers far more pairs than RANSAC on "
        "the raw matches."
    ),
    criterion=(
        "Rate of RANSAC on the group of GC, and on that of GTM, higher than on all matches, on U3OR and U3M."
    ),
)
def _check_grouping_first(evidence: ClaimEvidence) -> Finding:
    tests: list[Comparison] = []
    for place in _HARD:
        rates = evidence.need_same_cases(place, *_CHAINED, "ransac").overall("registered")
        tests += [expect_higher(rates, method, "ransac", f"{place}, rate:") for method in _CHAINED]
    return Finding(tests)


def _need_scores(evidence: ClaimEvidence, place: str, column: str, *methods: str) -> pd.Series:
    return evidence.need(_EXPERIMENT[place], place, *methods).overall(column)


def _expect_higher_mean(
    label: str, scores: pd.Series, methods: tuple[str, ...], others: tuple[str, ...]
) -> Comparison:
    first, second = float(scores[list(methods)].mean()), float(scores[list(others)].mean())
    text = f"{label} {show_score(first)} ({_NAMES[methods]}), {show_score(second)} ({_NAMES[others]})"
    return Comparison(first - second > TIE, text, first - second - TIE)
