"""Time: section 5.3."""

# pandas ships no types, and what is guessed from its source is often wrong.
# pyright: reportReturnType=false

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.benchmark.claims.base import TIME_TIE, Claim, Comparison, Finding, NotTestableError
from cgroup.benchmark.claims.measures import at_most, duration, higher, in_top
from cgroup.benchmark.paper import PAPER_COMPLEXITY
from cgroup.benchmark.records import exponents
from cgroup.benchmark.records.exponents import FITTED_FROM

if TYPE_CHECKING:
    import pandas as pd

    from cgroup.benchmark.claims.base import Records

_SECTION = "5.3, efficiency"
_LINEAR = 1.2  # exponent
_FAST = 0.1  # seconds
_LARGE_N = 3000


def _slowest_two(records: Records) -> Finding:
    return _ranked(records, ("st", "ransac"), 2, "slowest")


def _fastest_two(records: Records) -> Finding:
    return _ranked(records, ("nnsr", "3dhv"), 2, "fastest")


def _ss_slower_than_nnsr(records: Records) -> Finding:
    return _slower(records, "ss", "nnsr", TIME_TIE)


def _gtm_and_si_slow(records: Records) -> Finding:
    return _ranked(records, ("gtm", "si"), len(PAPER_COMPLEXITY) // 2, "slowest")


def _cv_far_below_si(records: Records) -> Finding:
    return _slower(records, "si", "cv", np.log(2))


def _hough_linear(records: Records) -> Finding:
    times = records.need_times("3dhv")["3dhv"]
    exponent = _fitted(records)["3dhv"]
    if np.isnan(exponent):
        message = f"times of fewer than two n from {FITTED_FROM}"
        raise NotTestableError(message)
    largest = times.index[-1]
    slow = float(times.iloc[-1])
    fast = Comparison(slow < _FAST, f"{duration(np.log(slow))} at n {largest}", _FAST - slow)
    return Finding([at_most("exponent of 3DHV", exponent, _LINEAR), fast])


def _st_slowest_when_large(records: Records) -> Finding:
    times = _log(records)
    if times.index[-1] < _LARGE_N:
        message = f"no times for n of {_LARGE_N} or more"
        raise NotTestableError(message)
    label = f"n {times.index[-1]}, slowest:"
    return Finding([in_top(times.iloc[-1], "st", 1, label, tie=TIME_TIE, show=duration)])


def _log(records: Records, *methods: str) -> pd.DataFrame:
    return np.log(records.need_times(*methods))


def _ranked(records: Records, methods: tuple[str, ...], k: int, order: str) -> Finding:
    """Each of the methods among the k slowest or fastest at each n."""
    sign = 1.0 if order == "slowest" else -1.0
    return Finding(
        [
            in_top(sign * row, method, k, f"n {n}:", tie=TIME_TIE, show=lambda x: duration(sign * x))
            for n, row in _log(records).iterrows()
            for method in methods
        ],
        summary=_exponents(records, methods),
    )


def _slower(records: Records, one: str, other: str, by: float) -> Finding:
    return Finding(
        [
            higher(row, one, other, f"n {n}:", by=by, show=duration)
            for n, row in _log(records, one, other).iterrows()
        ],
        summary=_exponents(records, (one, other)),
    )


def _exponents(records: Records, methods: tuple[str, ...]) -> str:
    fitted = _fitted(records)
    known = [f"{method.upper()} {fitted[method]:.2f}" for method in methods if not np.isnan(fitted[method])]
    return f"Exponents: {', '.join(known)}." if known else ""


def _fitted(records: Records) -> dict[str, float]:
    """Exponents of time over n; NaN where there are too few sets."""
    known = exponents(records.evidence.timing).set_index("method")["exponent"].to_dict()
    return {method: known.get(method, np.nan) for method in records.evidence.methods}


CLAIMS = (
    Claim(
        "C-56",
        _SECTION,
        "ST and RANSAC take longest, above all for large sets (this depends on the implementation).",
        "Each among the two slowest at each n.",
        _slowest_two,
    ),
    Claim(
        "C-57",
        _SECTION,
        "NNSR and 3DHV are the two fastest.",
        "Each among the two fastest at each n.",
        _fastest_two,
    ),
    Claim(
        "C-58",
        _SECTION,
        "SS is slower than NNSR, since it looks for its threshold.",
        "More than 5 % slower at each n.",
        _ss_slower_than_nnsr,
    ),
    Claim(
        "C-59",
        _SECTION,
        "GTM and SI are slower than most others.",
        "Each among the four slowest of nine at each n.",
        _gtm_and_si_slow,
    ),
    Claim(
        "C-60",
        _SECTION,
        "CV needs far less time than SI.",
        "Less than half at each n.",
        _cv_far_below_si,
    ),
    Claim(
        "C-61",
        _SECTION,
        "3DHV stays fast for thousands of matches, since its cost is linear.",
        "Fitted exponent <= 1.2, and less than 0.1 s at the largest n.",
        _hough_linear,
    ),
)

SLOWEST = Claim(
    "C-63",
    "6, summary",
    "ST takes the longest of all for large sets.",
    "Slowest at the largest n, which has to be 3000 or more.",
    _st_slowest_when_large,
)
"""Stands in the paper's summary, among others."""
