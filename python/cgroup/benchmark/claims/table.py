"""Verdicts as tables."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import asdict
from typing import TYPE_CHECKING

from cgroup.benchmark.claims.outcome import OUTCOMES
from cgroup.benchmark.claims.verdict import CRITERIA, ON_GENERATED

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from cgroup.benchmark.claims.verdict import Verdict


def count_verdicts(verdicts: Iterable[Verdict]) -> dict[str, int]:
    """Count the claims by verdict, all four kinds named.

    Parameters
    ----------
    verdicts : iterable of Verdict
        Of `check_claims`.

    Returns
    -------
    dict of str to int
        Confirmed, partly, not confirmed, not testable.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.claims import check_claims, count_verdicts
    >>> count_verdicts(check_claims(pd.DataFrame(), pd.DataFrame()))
    {'confirmed': 0, 'partly': 0, 'not confirmed': 0, 'not testable': 68}
    """
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

    Examples
    --------
    >>> import json
    >>> import pandas as pd
    >>> from cgroup.benchmark.claims import as_json, check_claims
    >>> json.loads(as_json(check_claims(pd.DataFrame(), pd.DataFrame())))[0]["verdict"]
    'not testable'
    """
    return json.dumps([asdict(verdict) for verdict in verdicts], indent=1, ensure_ascii=False)


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

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.claims import as_markdown, check_claims
    >>> as_markdown(check_claims(pd.DataFrame(), pd.DataFrame())).splitlines()[0]
    '# Claims of the paper'
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
    """Say how many claims have which verdict.

    Parameters
    ----------
    verdicts : iterable of Verdict
        Of `check_claims`.

    Returns
    -------
    str
        One line.

    Examples
    --------
    >>> from cgroup.benchmark.claims import counts_line
    >>> counts_line([])
    '0 claims: 0 confirmed, 0 partly, 0 not confirmed, 0 not testable'
    """
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
