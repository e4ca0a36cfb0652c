"""How the outcome of a claim's tests becomes a verdict."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup.benchmark.claims.base import ClaimEvidence, NotTestableError

if TYPE_CHECKING:
    from cgroup.benchmark.claims.base import Comparison, Finding
    from cgroup.benchmark.claims.claim import Claim
    from cgroup.benchmark.claims.outcome import Outcome, Stability
    from cgroup.benchmark.evidence import Evidence

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
- A claim isn't testable on generated shapes, which aren't what the paper measured, not even where they speak
  for one of several data sets; what comes out on them is quoted.
- A verdict is close if it changes in more than 10 % of the resamples, which are 200 by default. A resample
  draws the pairs of each data set with replacement, and of the times the repeats; resamples in which a claim
  isn't testable are left out.
"""
"""How verdicts come about; printed above every table of them."""

ON_GENERATED = "generated shapes aren't what the paper measured"
"""Begins the measured text of claims whose verdict would rest on them."""

_FAILING_SHOWN, _HOLDING_SHOWN = 4, 2  # tests quoted in the text of a verdict


@dataclass(frozen=True)
class Verdict:
    """What the records say about a claim.

    Attributes
    ----------
    id, paper_section, statement, criterion : str
        Of the claim.
    verdict : {"confirmed", "partly", "not confirmed", "not testable"}
        What the tests of the claim come to.
    measured : str
        The numbers; what is missing, where it isn't testable.
    data : str
        Data sets used, with the origin of their pairs.
    explanation : str
        Why it came out so on this data, where somebody has found out.
    held, tests : int
        How many of the tests that count hold, and how many there are; 0 where the claim isn't testable.
    stability : Stability, optional
        What the verdict is on other draws of the pairs, where they have been tried; None for a claim that
        isn't testable.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.claims import check_claims
    >>> verdict = check_claims(pd.DataFrame(), pd.DataFrame())[0]
    >>> verdict.id, verdict.verdict
    ('C-01', 'not testable')
    """

    id: str
    paper_section: str
    statement: str
    criterion: str
    verdict: Outcome
    measured: str
    data: str
    explanation: str = ""
    held: int = 0
    tests: int = 0
    stability: Stability | None = None


class Tally(NamedTuple):
    """What the tests of a claim come to.

    Attributes
    ----------
    outcome : str
        One of `OUTCOMES`, but never "not testable".
    held : int
        How many of the tests hold.
    counted : list of Comparison
        The tests that count.
    """

    outcome: Outcome
    held: int
    counted: list[Comparison]


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
    seen = ClaimEvidence(evidence)
    outcome: Outcome = "not testable"
    held = tests = 0
    try:
        finding = claim.check(seen)
        tally = count_tests(finding)
    except NotTestableError as missing:
        measured = str(missing)
    else:
        measured = _quote(tally.counted, finding.summary)
        generated = seen.list_generated()
        if generated:
            measured = f"{ON_GENERATED} ({', '.join(generated)}). On them: {measured}"
        else:
            outcome, held, tests = tally.outcome, tally.held, len(tally.counted)
    return Verdict(
        claim.id,
        claim.section,
        claim.statement,
        claim.criterion,
        outcome,
        measured,
        seen.describe(),
        explanation,
        held,
        tests,
    )


def count_tests(finding: Finding) -> Tally:
    """Say what the tests of a claim come to.

    Parameters
    ----------
    finding : Finding
        Of the claim's check.

    Returns
    -------
    Tally
        Of the tests without missing numbers.

    Raises
    ------
    NotTestableError
        If there is none.
    """
    counted = [test for test in finding.tests if not np.isnan(test.margin)]
    if not counted:
        message = "the records hold no level that the statement is about"
        raise NotTestableError(message)
    held = sum(bool(test.holds) for test in counted)
    share = held / len(counted)
    if share == 1 or (finding.need == "most" and share > 0.5):
        return Tally("confirmed", held, counted)
    outcome: Outcome = "partly" if share >= (0.5 if finding.need == "all" else 0.25) else "not confirmed"
    return Tally(outcome, held, counted)


def _quote(tests: list[Comparison], summary: str) -> str:
    """Count the tests that hold, and quote the few that decide."""
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
