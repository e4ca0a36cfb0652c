"""Time: section 5.3."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.claims.base import TIME_TIE, Comparison, Finding, NotTestableError
from cgroup.benchmark.claims.claim import claim
from cgroup.benchmark.claims.measures import expect_at_most, expect_higher, expect_in_top, show_time
from cgroup.benchmark.paper import PAPER_COMPLEXITY
from cgroup.benchmark.tables import FITTED_FROM

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import ClaimEvidence

_SECTION = "5.3, efficiency"
_LINEAR = 1.2  # exponent
_FAST = 0.1  # seconds


@claim(
    "C-56",
    section=_SECTION,
    statement="ST and RANSAC take longest, above all for large sets (this depends on the implementation).",
    criterion="Each among the two slowest at each n.",
)
def _check_slowest_two(evidence: ClaimEvidence) -> Finding:
    return _expect_at_each_n(evidence, ("st", "ransac"), 2, "slowest")


@claim(
    "C-57",
    section=_SECTION,
    statement="NNSR and 3DHV are the two fastest.",
    criterion="Each among the two fastest at each n.",
)
def _check_fastest_two(evidence: ClaimEvidence) -> Finding:
    return _expect_at_each_n(evidence, ("nnsr", "3dhv"), 2, "fastest")


@claim(
    "C-58",
    section=_SECTION,
    statement="SS is slower than NNSR, since it looks for its threshold.",
    criterion="More than 5 % slower at each n.",
)
def _check_ss_slower_than_nnsr(evidence: ClaimEvidence) -> Finding:
    return _expect_slower(evidence, "ss", "nnsr", TIME_TIE)


@claim(
    "C-59",
    section=_SECTION,
    statement="GTM and SI are slower than most others.",
    criterion="Each among the four slowest of nine at each n.",
)
def _check_gtm_and_si_slow(evidence: ClaimEvidence) -> Finding:
    return _expect_at_each_n(evidence, ("gtm", "si"), len(PAPER_COMPLEXITY) // 2, "slowest")


@claim(
    "C-60",
    section=_SECTION,
    statement="CV needs far less time than SI.",
    criterion="Less than half at each n.",
)
def _check_cv_far_below_si(evidence: ClaimEvidence) -> Finding:
    return _expect_slower(evidence, "si", "cv", np.log(2))


@claim(
    "C-61",
    section=_SECTION,
    statement="3DHV stays fast for thousands of matches, since its cost is linear.",
    criterion="Fitted exponent <= 1.2, and less than 0.1 s at the largest n.",
)
def _check_hough_linear(evidence: ClaimEvidence) -> Finding:
    times = evidence.need_times("3dhv")["3dhv"]
    exponent = evidence.all.exponents["3dhv"]
    if np.isnan(exponent):
        message = f"times of fewer than two n from {FITTED_FROM}"
        raise NotTestableError(message)
    largest = times.index[-1]
    slow = float(times.iloc[-1])
    fast = Comparison(slow < _FAST, f"{show_time(np.log(slow))} at n {largest}", _FAST - slow)
    return Finding([expect_at_most("exponent of 3DHV", exponent, _LINEAR), fast])


def _expect_at_each_n(evidence: ClaimEvidence, methods: tuple[str, ...], k: int, order: str) -> Finding:
    """Each of the methods among the k slowest or fastest at each n."""
    sign = 1.0 if order == "slowest" else -1.0
    return Finding(
        [
            expect_in_top(sign * row, method, k, f"n {n}:", tie=TIME_TIE, show=lambda x: show_time(sign * x))
            for n, row in np.log(evidence.need_times()).iterrows()
            for method in methods
        ],
        summary=_show_exponents(evidence, methods),
    )


def _expect_slower(evidence: ClaimEvidence, one: str, other: str, by: float) -> Finding:
    return Finding(
        [
            expect_higher(row, one, other, f"n {n}:", by=by, show=show_time)
            for n, row in np.log(evidence.need_times(one, other)).iterrows()
        ],
        summary=_show_exponents(evidence, (one, other)),
    )


def _show_exponents(evidence: ClaimEvidence, methods: tuple[str, ...]) -> str:
    fitted = evidence.all.exponents
    known = [f"{method.upper()} {fitted[method]:.2f}" for method in methods if not np.isnan(fitted[method])]
    return f"Exponents: {', '.join(known)}." if known else ""
