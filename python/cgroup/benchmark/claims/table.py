"""Verdicts as tables."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from rich.table import Table

from cgroup.benchmark.claims.base import CRITERIA, OUTCOMES

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from cgroup.benchmark.claims.base import Verdict

_COLORS = {"confirmed": "green", "partly": "yellow", "not confirmed": "red", "not testable": "bright_black"}


def count_verdicts(verdicts: Iterable[Verdict]) -> dict[str, int]:
    """Count the claims by verdict, all four kinds named."""
    counts = Counter(verdict.verdict for verdict in verdicts)
    return {outcome: counts[outcome] for outcome in OUTCOMES}


def claims_rows(verdicts: Iterable[Verdict]) -> list[dict[str, str]]:
    """List the verdicts as rows of text, for JSON and data frames.

    Parameters
    ----------
    verdicts : iterable of Verdict
        One row each.

    Returns
    -------
    list of dict
        The fields of `Verdict`.
    """
    return [dict(vars(verdict)) for verdict in verdicts]


def claims_table(verdicts: Sequence[Verdict]) -> Table:
    """Lay the verdicts out for a terminal.

    Parameters
    ----------
    verdicts : sequence of Verdict
        One row each.

    Returns
    -------
    rich.table.Table
        With the counts as caption.
    """
    table = Table(caption=counts_line(verdicts), show_lines=True)
    for header in ("claim", "the paper says", "verdict", "measured", "data"):
        table.add_column(header, no_wrap=header == "claim", ratio=2 if header == "measured" else None)
    for verdict in verdicts:
        color = _COLORS[verdict.verdict]
        measured = verdict.measured + (f" Why: {verdict.explanation}" if verdict.explanation else "")
        table.add_row(
            verdict.id,
            verdict.statement,
            f"[{color}]{verdict.verdict}[/{color}]",
            measured.replace("[", r"\["),
            verdict.data,
        )
    return table


def claims_markdown(verdicts: Sequence[Verdict]) -> str:
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
    counts = count_verdicts(verdicts)
    return f"{sum(counts.values())} claims: " + ", ".join(f"{n} {outcome}" for outcome, n in counts.items())


def _markdown_row(verdict: Verdict) -> str:
    claim = f"**{verdict.id}** {verdict.statement} *Test: {verdict.criterion}*"
    measured = verdict.measured + (f" **Why:** {verdict.explanation}" if verdict.explanation else "")
    cells = (claim, verdict.verdict, measured, verdict.data)
    return "| " + " | ".join(cell.replace("|", r"\|").replace("\n", " ") for cell in cells) + " |"
