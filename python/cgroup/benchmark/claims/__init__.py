"""What the paper says, and whether the records bear it out."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from cgroup._checks.values import as_count
from cgroup.benchmark.claims.catalog import CLAIMS
from cgroup.benchmark.claims.claim import Claim
from cgroup.benchmark.claims.explanations import read_explanations
from cgroup.benchmark.claims.outcome import OUTCOMES, Outcome, Stability
from cgroup.benchmark.claims.stability import RESAMPLES, bootstrap_outcomes, bootstrap_verdicts
from cgroup.benchmark.claims.table import as_json, as_markdown, count_verdicts, counts_line
from cgroup.benchmark.claims.verdict import CRITERIA, Verdict, decide
from cgroup.benchmark.evidence import Evidence

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "CLAIMS",
    "CRITERIA",
    "OUTCOMES",
    "RESAMPLES",
    "Claim",
    "Outcome",
    "Stability",
    "Verdict",
    "as_json",
    "as_markdown",
    "bootstrap_verdicts",
    "check_claims",
    "check_evidence",
    "count_verdicts",
    "counts_line",
]


def check_claims(
    frame: pd.DataFrame, timing: pd.DataFrame, *, resamples: int = 0, seed: int = 0
) -> list[Verdict]:
    """Check all claims of the paper on the records.

    Parameters
    ----------
    frame : DataFrame
        Records, one row per case, method and threshold.
    timing : DataFrame
        Times of the timing experiment; may have no rows.
    resamples : int
        On how many draws of the pairs claims are checked again, which gives verdicts their `stability`;
        on none by default.
    seed : int
        Of the draws.

    Returns
    -------
    list of Verdict
        One per claim, in the paper's order; `CRITERIA` says how they come about.

    Raises
    ------
    InputError
        If the number of resamples or the seed isn't a whole number from 0.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.claims import check_claims
    >>> verdicts = check_claims(pd.DataFrame(), pd.DataFrame())  # no records
    >>> {verdict.verdict for verdict in verdicts}
    {'not testable'}
    """
    return check_evidence(Evidence(frame, timing), resamples=resamples, seed=seed)


def check_evidence(evidence: Evidence, *, resamples: int = 0, seed: int = 0) -> list[Verdict]:
    """Check all claims of the paper on evidence that is at hand.

    Parameters
    ----------
    evidence : Evidence
        Records and times, sorted by experiment and data set.
    resamples : int
        On how many draws of the pairs claims are checked again, which gives verdicts their `stability`;
        on none by default.
    seed : int
        Of the draws.

    Returns
    -------
    list of Verdict
        One per claim, in the paper's order.

    Raises
    ------
    InputError
        If the number of resamples or the seed isn't a whole number from 0.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.claims import check_evidence
    >>> from cgroup.benchmark.evidence import Evidence
    >>> len(check_evidence(Evidence(pd.DataFrame(), pd.DataFrame())))
    68
    """
    resamples, seed = as_count("resamples", resamples, 0), as_count("seed", seed, 0)
    why = read_explanations()
    verdicts = [decide(claim, evidence, why.get(claim.id, "")) for claim in CLAIMS]
    if not resamples:
        return verdicts
    found: dict[Claim, Outcome] = {claim: each.verdict for claim, each in zip(CLAIMS, verdicts, strict=True)}
    known = bootstrap_outcomes(evidence, found, resamples=resamples, seed=seed)
    return [replace(each, stability=known.get(each.id)) for each in verdicts]
