"""What a claim is, and how the outcome of its tests becomes a verdict."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple, TypeAlias

import numpy as np

from cgroup.benchmark.paper import PLACES

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import pandas as pd

    from cgroup.benchmark.evidence import Evidence, Sample

Outcome: TypeAlias = Literal["confirmed", "partly", "not confirmed", "not testable"]

OUTCOMES: tuple[Outcome, ...] = ("confirmed", "partly", "not confirmed", "not testable")

CRITERIA = """\
Every claim is taken apart into tests that hold or don't: one per level, per method, or per pair of
methods, as its statement says. The same rules serve all claims.

- Precision, recall, F and registration rate are means over pairs (macro), failed records left out.
  A statement that names no levels is tested on the mean over all of them.
- A difference within 0.01 is a tie. "Best", "second" and "among the top" tolerate ties: X is among the
  top k if fewer than k others are better by more than 0.01. "Higher", "lower", "grows" and "falls" need a
  difference of more than 0.01. Times within 5 % are a tie.
- A statement about all cases is confirmed if all tests hold; one that says "most" or "generally", if more
  than half do. It holds partly if at least half of the tests that it needs do: half, or a quarter.
- "Large gap" means more than 0.1, "clear" more than 0.05, "rarely" at most 10 %, "usually" more than half,
  "far fewer" and "far less" at most half.
- "From the lowest to the highest level" are those in the records. A level that a statement names has to
  be there, or the statement isn't testable; so has every method that it is about.
- Registration is the paper's: precision above 0.1.
"""
"""How verdicts come about; printed above every table of them."""

TIE = 0.01
LARGE = 0.1
CLEAR = 0.05
TIME_TIE = math.log(1.05)
"""Tolerances on scores, and on logarithms of times."""

_FAILING_SHOWN, _HOLDING_SHOWN = 4, 2  # tests quoted in the text of a verdict
_TIMING = "timing experiment"


class Comparison(NamedTuple):
    """One comparison of numbers.

    Attributes
    ----------
    holds : bool
        Whether it is as the claim says.
    text : str
        What was compared, with the numbers.
    margin : float
        By how much it holds, or fails if negative; NaN where a number is missing.
    """

    holds: bool
    text: str
    margin: float


@dataclass(frozen=True)
class Finding:
    """Outcome of a claim's tests.

    Attributes
    ----------
    tests : sequence of Comparison
        Those with missing numbers don't count.
    need : "all" or "most"
        How many have to hold.
    summary : str
        Numbers worth reading besides those of the tests.
    """

    tests: Sequence[Comparison]
    need: Literal["all", "most"] = "all"
    summary: str = ""


class NotTestableError(Exception):
    """Records that a claim needs are missing; the message says which."""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper.

    Attributes
    ----------
    id : str
        ``C-01`` and so on.
    section : str
        Of the paper.
    statement : str
        In our own words.
    criterion : str
        What is tested.
    check : callable
        From `Records` to `Finding`; raises `NotTestableError`.
    """

    id: str
    section: str
    statement: str
    criterion: str
    check: Callable[[Records], Finding]


@dataclass(frozen=True)
class Verdict:
    """What the records say about a claim.

    Attributes
    ----------
    id, paper_section, statement, criterion : str
        Of the claim.
    verdict : str
        One of `OUTCOMES`.
    measured : str
        The numbers; what is missing, where it isn't testable.
    data : str
        Data sets used, with the origin of their pairs.
    explanation : str
        Why it came out so on this data, where somebody has found out.
    """

    id: str
    paper_section: str
    statement: str
    criterion: str
    verdict: Outcome
    measured: str
    data: str
    explanation: str = ""


@dataclass(frozen=True, eq=False)
class Records:
    """The evidence as one claim sees it; remembers what was asked for."""

    evidence: Evidence
    used: list[str] = field(default_factory=list)

    def need(self, experiment: str, place: str, *methods: str) -> Sample:
        """Find the records of an experiment with all nine methods, or those named."""
        sample = self.evidence.sample(experiment, place)
        if sample is None:
            wanted = ", ".join(PLACES[place])
            message = f"no records of experiment '{experiment}' on {place} (data sets: {wanted})"
            raise NotTestableError(message)
        if sample.description not in self.used:
            self.used.append(sample.description)
        present = set(sample.rows["method"])
        missing = [each for each in methods or self.evidence.methods if each not in present]
        if missing:
            message = f"no records of {names(missing)} in experiment '{experiment}' on {sample.dataset}"
            raise NotTestableError(message)
        return sample

    def need_same_cases(self, place: str, *methods: str) -> Sample:
        """Find the records of some methods on the cases that all of them were run on."""
        sample = self.evidence.same_cases(place, methods)
        if sample is None:
            message = f"no case on {place} with {names(methods)}; run an experiment with these methods"
            raise NotTestableError(message)
        if sample.description not in self.used:
            self.used.append(sample.description)
        return sample

    def need_times(self, *methods: str) -> pd.DataFrame:
        """Find the mean seconds on one thread: one row per n, one column per method."""
        times = mean_times(self.evidence.timing)
        missing = [each for each in methods or self.evidence.methods if each not in times.columns]
        if missing:
            message = f"no times of {names(missing)}; run the timing experiment"
            raise NotTestableError(message)
        if _TIMING not in self.used:
            self.used.append(_TIMING)
        return times


def mean_times(timing: pd.DataFrame) -> pd.DataFrame:
    """Mean seconds of the repeats on one thread.

    Parameters
    ----------
    timing : DataFrame
        Times of the timing experiment.

    Returns
    -------
    DataFrame
        One row per n, one column per method; empty where there are no times.
    """
    if timing.empty:
        return timing
    single = timing[timing["threads"] == 1]
    return single.pivot_table(index="n", columns="method", values="seconds", aggfunc="mean")


def decide(claim: Claim, evidence: Evidence, explanation: str = "") -> Verdict:
    """Check one claim.

    Parameters
    ----------
    claim : Claim
        What to check.
    evidence : Evidence
        All records.
    explanation : str
        Goes with the verdict.

    Returns
    -------
    Verdict
        Also where the claim isn't testable.
    """
    records = Records(evidence)
    try:
        outcome, measured = _judged(claim.check(records))
    except NotTestableError as missing:
        outcome, measured = "not testable", str(missing)
    return Verdict(
        claim.id,
        claim.section,
        claim.statement,
        claim.criterion,
        outcome,
        measured,
        "; ".join(records.used),
        explanation,
    )


def _judged(finding: Finding) -> tuple[Outcome, str]:
    counted = [test for test in finding.tests if not np.isnan(test.margin)]
    if not counted:
        message = "the records hold no level that the statement is about"
        raise NotTestableError(message)
    share = sum(test.holds for test in counted) / len(counted)
    if share == 1 or (finding.need == "most" and share > 0.5):
        outcome: Outcome = "confirmed"
    else:
        outcome = "partly" if share >= (0.5 if finding.need == "all" else 0.25) else "not confirmed"
    return outcome, _measured(counted, finding.summary)


def _measured(tests: list[Comparison], summary: str) -> str:
    failing = [test for test in tests if not test.holds]
    count = f"{len(tests) - len(failing)} of {len(tests)}"
    if len(tests) <= _FAILING_SHOWN:
        quoted = "; ".join(test.text + ("" if test.holds else " [fails]") for test in tests)
        text = f"{count}: {quoted}"
    else:
        shown = _FAILING_SHOWN if failing else _HOLDING_SHOWN
        picked = sorted(failing or tests, key=lambda test: test.margin)[:shown]
        more = len(failing) - len(picked)
        label = "fails at" if failing else "closest calls"
        text = f"{count}; {label}: " + "; ".join(test.text for test in picked)
        text += f"; and {more} more" if more > 0 else ""
    return f"{text}. {summary}".strip() if summary else f"{text}."


def names(methods: Sequence[str]) -> str:
    """Methods for people."""
    return ", ".join(each.upper() for each in methods)
