"""Verdicts as tables."""

from __future__ import annotations

import json
from collections import Counter
from typing import TYPE_CHECKING

from cgroup.benchmark.claims.verdict import CRITERIA, ON_GENERATED, OUTCOMES

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from cgroup.benchmark.claims.verdict import Verdict


def count_verdicts(verdicts: Iterable[Verdict]) -> dict[str, int]:
    """Count the claims by verdict, all four kinds named."""
    counts = Counter(verdict.verdict for verdict in verdicts)
    return {outcome: counts[outcome] for outcome in OUTCOMES}


def as_json(verdicts: Iterable[Verdict]) -> str:
    """Write the verdicts as JSON.

    Parameters
    ----------
    verdicts : iterable of Verdict
        One object each, with the fields of `Verdict`.

    Returns
    -------
    str
        A list.
    """
    return json.dumps([vars(verdict) for verdict in verdicts], indent=1, ensure_ascii=False)


def as_markdown(verdicts: Sequence[Verdict]) -> str:
    """Write the verdicts as Markdown, by section of the paper.

    Parameters
    ----------
    verdicts : sequence of Verdict
        In the paper's order.

    Returns
    -------
    str
        The criteria, the counts, and one table per section.
    """
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
    return f"{len(listed)} claims: {counts}{why}"


def _markdown_row(verdict: Verdict) -> str:
    claim = f"**{verdict.id}** {verdict.statement} *Test: {verdict.criterion}*"
    measured = verdict.measured + (f" **Why:** {verdict.explanation}" if verdict.explanation else "")
    cells = (claim, verdict.verdict, measured, verdict.data)
    return "| " + " | ".join(cell.replace("|", r"\|").replace("\n", " ") for cell in cells) + " |"
