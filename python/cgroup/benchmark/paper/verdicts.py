"""How the tests of a claim become a verdict, how sure it is, and verdicts as tables."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from importlib.resources import files
from math import floor
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import numpy as np

from cgroup.benchmark.paper.checks import NotTestableError, Witness

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports] - on Python 3.10 only

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from cgroup.benchmark.paper.checks import Check, Comparison
    from cgroup.benchmark.paper.evidence import Evidence

Outcome: TypeAlias = Literal["confirmed", "partly", "not confirmed", "not testable"]

OUTCOMES: tuple[Outcome, ...] = ("confirmed", "partly", "not confirmed", "not testable")

CLOSE = 0.1
"""A verdict is close if it changes in a larger share of the resamples."""

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
class Stability:
    """What a verdict is on other draws of the same pairs.

    Attributes
    ----------
    share : float
        Of the resamples in which the claim is testable, those with the verdict that all pairs give; 0 where
        there are none.
    close : bool
        Whether the verdict changes in more than 10 % of them.
    counts : dict of str to int
        Resamples by verdict; not testable are those in which a level has lost all its pairs.

    Examples
    --------
    >>> from cgroup.benchmark.paper.claims import Stability
    >>> Stability.of(
    ...     "partly", {"partly": 150, "confirmed": 30, "not testable": 20}
    ... ).close
    True
    """

    share: float
    close: bool
    counts: dict[Outcome, int]

    @classmethod
    def of(cls, outcome: Outcome, counts: Mapping[Outcome, int]) -> Stability:
        """Compare the verdicts of resamples with that of all pairs.

        Parameters
        ----------
        outcome : str
            On all pairs.
        counts : mapping of str to int
            Resamples by verdict.

        Returns
        -------
        Stability
            With all four kinds of verdicts counted.

        Examples
        --------
        >>> from cgroup.benchmark.paper.claims import Stability
        >>> Stability.of("confirmed", {"confirmed": 195, "partly": 5}).share
        0.975
        """
        tested = sum(count for each, count in counts.items() if each != "not testable")
        same = counts.get(outcome, 0)
        share = same / tested if tested else 0.0
        close = tested - same > CLOSE * tested or not tested
        return cls(share, close, {each: counts.get(each, 0) for each in OUTCOMES})

    def __str__(self) -> str:
        """Return the share in percent, and whether the verdict is close."""
        return f"{floor(100 * self.share + 1e-9)} %" + (", close" if self.close else "")


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
    >>> from cgroup.benchmark.paper.claims import check_claims
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
    """What the tests of a claim come to: the outcome, how many of the tests hold, and those that count."""

    outcome: Outcome
    held: int
    counted: list[Comparison]


def judge(check: Check, evidence: Evidence) -> dict[str, Any]:
    """Find what the records say about a claim: the fields of its `Verdict` that depend on them."""
    witness = Witness(evidence)
    outcome: Outcome = "not testable"
    held = tests = 0
    try:
        tally = count_tests(check.find(witness), check.need)
        measured = _quote(tally.counted, check.summarize(witness))
    except NotTestableError as missing:
        measured = str(missing)
    else:
        generated = witness.list_generated()
        if generated:
            measured = f"{ON_GENERATED} ({', '.join(generated)}). On them: {measured}"
        else:
            outcome, held, tests = tally.outcome, tally.held, len(tally.counted)
    found = {"verdict": outcome, "measured": measured, "data": witness.describe()}
    return {**found, "held": held, "tests": tests}


def count_tests(found: Sequence[Comparison], need: Literal["all", "most"]) -> Tally:
    """Say what the tests without missing numbers come to; without any, the claim isn't testable."""
    counted = [test for test in found if not np.isnan(test.margin)]
    if not counted:
        message = "the records hold no level that the statement is about"
        raise NotTestableError(message)
    held = sum(bool(test.holds) for test in counted)
    share = held / len(counted)
    if share == 1 or (need == "most" and share > 0.5):
        return Tally("confirmed", held, counted)
    outcome: Outcome = "partly" if share >= (0.5 if need == "all" else 0.25) else "not confirmed"
    return Tally(outcome, held, counted)


def read_explanations() -> dict[str, str]:
    """Why claims came out as they did, by id, for those that somebody has looked into."""
    text = files("cgroup.benchmark.paper").joinpath("explanations.toml").read_text(encoding="utf-8")
    return {name: str(value) for name, value in tomllib.loads(text).items()}


def count_verdicts(verdicts: Iterable[Verdict]) -> dict[str, int]:
    """Count the claims by verdict, all four kinds named."""
    counts = Counter(verdict.verdict for verdict in verdicts)
    return {outcome: counts[outcome] for outcome in OUTCOMES}


def as_markdown(verdicts: Sequence[Verdict]) -> str:
    """Write the verdicts as Markdown, by section of the paper."""
    lines = ["# Claims of the paper", "", CRITERIA.strip(), "", f"**{counts_line(verdicts)}**"]
    section = ""
    for verdict in verdicts:
        if verdict.paper_section != section:
            section = verdict.paper_section
            lines += ["", f"## {section}", "", "| claim | verdict | measured | data |", "|---|---|---|---|"]
        lines.append(_markdown_row(verdict))
    return "\n".join(lines) + "\n"


def counts_line(verdicts: Iterable[Verdict]) -> str:
    """Say how many claims have which verdict."""
    listed = list(verdicts)
    generated = sum(verdict.measured.startswith(ON_GENERATED) for verdict in listed)
    counts = ", ".join(f"{n} {outcome}" for outcome, n in count_verdicts(listed).items())
    why = f"; {generated} would rest on generated shapes, not what the paper measured" if generated else ""
    tried = [verdict.stability for verdict in listed if verdict.stability is not None]
    close = f"; {sum(each.close for each in tried)} verdicts are close" if tried else ""
    return f"{len(listed)} claims: {counts}{why}{close}"


def _markdown_row(verdict: Verdict) -> str:
    claim = f"**{verdict.id}** {verdict.statement} *Test: {verdict.criterion}*"
    measured = verdict.measured + (f" **Why:** {verdict.explanation}" if verdict.explanation else "")
    outcome = f"{verdict.verdict} ({verdict.stability})" if verdict.stability else verdict.verdict
    cells = (claim, outcome, measured, verdict.data)
    return "| " + " | ".join(cell.replace("|", r"\|").replace("\n", " ") for cell in cells) + " |"


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
