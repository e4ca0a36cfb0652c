"""The claims of the paper, and the verdict of the records on each."""

import functools
import math
import operator
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import pandas as pd

from cgroup._runtime.toml import load_packaged
from cgroup.benchmark.paper import checks, numbers, table
from cgroup.benchmark.paper.checks import Check, Comparison
from cgroup.benchmark.paper.evidence import Evidence
from cgroup.benchmark.paper.table import ClaimTable, NotTestableError, Source, Witness, make_table, named
from cgroup.benchmark.problem import COMBINATIONS

__all__ = ["CLAIMS", "CRITERIA", "OUTCOMES", "Outcome", "check_claims"]

Outcome: TypeAlias = Literal["confirmed", "partly", "not confirmed", "not testable"]

OUTCOMES: tuple[Outcome, ...] = ("confirmed", "partly", "not confirmed", "not testable")

_DEFINITIONS = load_packaged("cgroup.benchmark.paper", "claims.toml")
CRITERIA: str = _DEFINITIONS["criteria"]
"""Rules of the verdicts; printed above every table of them."""

# Begins the measured text of claims whose verdict would rest on them
ON_GENERATED = "generated shapes aren't what the paper measured"
_FAILING_SHOWN, _HOLDING_SHOWN = 4, 2  # tests quoted in the text of a verdict


@dataclass(frozen=True)
class Verdict:
    """Result of testing a claim on the records; `held` of its `tests` hold, both 0 if it isn't testable."""

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


@dataclass(frozen=True)
class Claim:
    """A statement of the paper in our words, its section, and its check on the records."""

    id: str
    section: str
    statement: str
    check: Check

    @property
    def criterion(self) -> str:
        """The test, in one sentence."""
        text = self.check.criterion
        return f"{text[0].upper()}{text[1:]}."


_FUNCTIONS = {**vars(table), **vars(numbers), **vars(checks), "log": math.log}
_NAMES: dict[str, Any] = {name: Source(*parts) for name, parts in _DEFINITIONS["sources"].items()}
_NAMES["ALL_SIX"] = named(*COMBINATIONS)


def _read_claims() -> Iterator[Claim]:
    for each in _DEFINITIONS["claim"]:
        first, *others = map(_build, each.pop("checks"))
        yield Claim(**each, check=functools.reduce(operator.and_, others, first))


def _build(part: Any) -> Any:  # noqa: ANN401 - part of a check
    """Return the value of a part of a check: the result of a call, the value of a name, or itself."""
    if isinstance(part, str):
        return _NAMES.get(part, part)
    if not isinstance(part, list) or part[0] not in _FUNCTIONS:
        return part
    name, *given = part
    options = given.pop() if isinstance(given[-1], dict) else {}
    return _FUNCTIONS[name](*map(_build, given), **options)


CLAIMS = tuple(_read_claims())
"""All claims of the paper, in its order."""


def check_claims(frame: pd.DataFrame, timing: pd.DataFrame) -> list[Verdict]:
    """Check all claims of the paper on the records.

    Parameters
    ----------
    frame : DataFrame
        Records, one row per case, method and threshold.
    timing : DataFrame
        Times of the timing experiment; may have no rows.

    Returns
    -------
    list of Verdict
        One per claim, in the paper's order; `CRITERIA` has the rules. Each has `id, paper_section, statement,
        criterion` of the claim, the `verdict` (one of `OUTCOMES`), the numbers (`measured`) or missing
        records, the `data`, and an `explanation` if one is known.
    """
    return check_evidence(Evidence(frame, timing))


def check_evidence(evidence: Evidence) -> list[Verdict]:
    """Check all claims of the paper on given evidence."""
    means, why = make_table(evidence), read_explanations()
    return [decide(claim, means, why.get(claim.id, "")) for claim in CLAIMS]


def read_explanations() -> dict[str, str]:
    """Return the known explanations of verdicts, by claim."""
    return load_packaged("cgroup.benchmark.paper", "explanations.toml")


def decide(claim: Claim, means: ClaimTable, explanation: str = "") -> Verdict:
    """Check one claim."""
    witness = Witness(means)
    outcome: Outcome = "not testable"
    held = tests = 0
    try:
        counted = [test for test in claim.check.find(witness) if not np.isnan(test.margin)]
        found, measured = find_outcome(counted, claim.check.need), _quote(counted)
    except NotTestableError as missing:
        measured = str(missing)
    else:
        generated = dict.fromkeys(name for origin in witness.used.values() for name in origin.generated)
        if generated:
            measured = f"{ON_GENERATED} ({', '.join(generated)}). On them: {measured}"
        else:
            outcome, held, tests = found, sum(bool(test.holds) for test in counted), len(counted)
    about = (claim.id, claim.section, claim.statement, claim.criterion)
    return Verdict(*about, outcome, measured, witness.describe(), explanation, held, tests)


def find_outcome(counted: Sequence[Comparison], need: Literal["all", "most"]) -> Outcome:
    """Return the outcome of tests; raise if there are none."""
    if not counted:
        raise NotTestableError("the records hold no level that the statement is about")
    share = sum(bool(test.holds) for test in counted) / len(counted)
    if share == 1 or (need == "most" and share > 0.5):
        return "confirmed"
    return "partly" if share >= (0.5 if need == "all" else 0.25) else "not confirmed"


def count_verdicts(verdicts: Iterable[Verdict]) -> dict[str, int]:
    """Count the claims by verdict, for all four verdicts."""
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
    """Return a sentence with the number of claims by verdict."""
    listed = list(verdicts)
    generated = sum(verdict.measured.startswith(ON_GENERATED) for verdict in listed)
    counts = ", ".join(f"{n} {outcome}" for outcome, n in count_verdicts(listed).items())
    why = f"; {generated} would rest on generated shapes, not what the paper measured" if generated else ""
    return f"{len(listed)} claims: {counts}{why}"


def _markdown_row(verdict: Verdict) -> str:
    claim = f"**{verdict.id}** {verdict.statement} *Test: {verdict.criterion}*"
    measured = verdict.measured + (f" **Why:** {verdict.explanation}" if verdict.explanation else "")
    cells = (claim, verdict.verdict, measured, verdict.data)
    return "| " + " | ".join(cell.replace("|", r"\|").replace("\n", " ") for cell in cells) + " |"


def _quote(tests: list[Comparison]) -> str:
    """Count the tests that hold, and quote the decisive ones."""
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
    return f"{text}."
