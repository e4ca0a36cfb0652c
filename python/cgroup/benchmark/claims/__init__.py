"""What the paper says, and whether the records bear it out."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup.benchmark.claims import (
    clutter_occlusion,
    combinations,
    density,
    efficiency,
    epsilon,
    inputs,
    matches,
    noise,
    overlap,
    registration,
    registration_inputs,
    summary,
)
from cgroup.benchmark.claims.claim import Claim, collect_claims
from cgroup.benchmark.claims.explanations import read_explanations
from cgroup.benchmark.claims.table import as_json, as_markdown, count_verdicts, counts_line
from cgroup.benchmark.claims.verdict import CRITERIA, OUTCOMES, Outcome, Verdict, decide
from cgroup.benchmark.evidence import Evidence

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "CLAIMS",
    "CRITERIA",
    "OUTCOMES",
    "Claim",
    "Outcome",
    "Verdict",
    "as_json",
    "as_markdown",
    "check_claims",
    "check_evidence",
    "count_verdicts",
    "counts_line",
]

CLAIMS = collect_claims(
    inputs,
    noise,
    density,
    clutter_occlusion,
    overlap,
    epsilon,
    matches,
    combinations,
    registration,
    registration_inputs,
    efficiency,
    summary,
)
"""In the paper's order."""


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
        One per claim, in the paper's order; `CRITERIA` says how they come about.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.claims import check_claims
    >>> verdicts = check_claims(pd.DataFrame(), pd.DataFrame())  # no records
    >>> {verdict.verdict for verdict in verdicts}
    {'not testable'}
    """
    return check_evidence(Evidence(frame, timing))


def check_evidence(evidence: Evidence) -> list[Verdict]:
    """Check all claims of the paper on evidence that is at hand.

    Parameters
    ----------
    evidence : Evidence
        Records and times, sorted by experiment and data set.

    Returns
    -------
    list of Verdict
        One per claim, in the paper's order.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.claims import check_evidence
    >>> from cgroup.benchmark.evidence import Evidence
    >>> len(check_evidence(Evidence(pd.DataFrame(), pd.DataFrame())))
    68
    """
    why = read_explanations()
    return [decide(claim, evidence, why.get(claim.id, "")) for claim in CLAIMS]
