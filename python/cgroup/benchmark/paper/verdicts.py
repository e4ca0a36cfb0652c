"""Verdicts on claims, and their tables."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Literal, TypeAlias

import numpy as np

from cgroup._runtime.toml import tomllib
from cgroup.benchmark.paper.checks import Check, Comparison
from cgroup.benchmark.paper.table import ClaimTable, NotTestableError, Witness

Outcome: TypeAlias = Literal["confirmed", "partly", "not confirmed", "not testable"]

OUTCOMES: tuple[Outcome, ...] = ("confirmed", "partly", "not confirmed", "not testable")

CRITERIA = """\
A claim is split into tests that hold or fail: one per level, per method, or per pair of methods, as its
statement requires. All claims share these rules.

- Precision, recall, F and registration rate are means over pairs (macro), without failed records.
  A statement that names no level is tested on the mean over all levels.
- Scores within 0.01 and times within 5 % are a tie. "Best", "second" and "among the top" tolerate ties: X is
  among the top k if fewer than k others are better by more than a tie. "Higher", "lower", "grows" and
  "falls" need a difference of more than a tie.
- "Large gap" means more than 0.1, "clear" more than 0.05, "rarely" at most 10 %, "usually" more than half,
  "far fewer" and "far less" at most half.
- A claim is confirmed if all tests hold; if it states "most" or "generally", if more than half do. It is
  confirmed in part if at least half of these hold: half of the tests, or a quarter.
- A claim isn't testable without a method or a level that its statement names, nor on generated shapes, which
  the paper didn't measure. The results on generated shapes are quoted.
"""
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


def judge(check: Check, table: ClaimTable) -> dict[str, Any]:
    """Test a claim; return the fields of its `Verdict` that depend on the records."""
    witness = Witness(table)
    outcome: Outcome = "not testable"
    held = tests = 0
    try:
        counted = [test for test in check.find(witness) if not np.isnan(test.margin)]
        found, measured = find_outcome(counted, check.need), _quote(counted)
    except NotTestableError as missing:
        measured = str(missing)
    else:
        generated = dict.fromkeys(name for origin in witness.used.values() for name in origin.generated)
        if generated:
            measured = f"{ON_GENERATED} ({', '.join(generated)}). On them: {measured}"
        else:
            outcome, held, tests = found, sum(bool(test.holds) for test in counted), len(counted)
    fields = {"verdict": outcome, "measured": measured, "data": witness.describe()}
    return {**fields, "held": held, "tests": tests}


def find_outcome(counted: Sequence[Comparison], need: Literal["all", "most"]) -> Outcome:
    """Return the outcome of tests; raise if there are none."""
    if not counted:
        raise NotTestableError("the records hold no level that the statement is about")
    share = sum(bool(test.holds) for test in counted) / len(counted)
    if share == 1 or (need == "most" and share > 0.5):
        return "confirmed"
    return "partly" if share >= (0.5 if need == "all" else 0.25) else "not confirmed"


def read_explanations() -> dict[str, str]:
    """Return the known explanations of verdicts, by claim."""
    text = files("cgroup.benchmark.paper").joinpath("explanations.toml").read_text(encoding="utf-8")
    return {name: str(value) for name, value in tomllib.loads(text).items()}


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
