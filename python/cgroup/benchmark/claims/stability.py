"""How sure verdicts are: what they would be on other draws of the same pairs."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

from cgroup._checks.values import as_count
from cgroup.benchmark.claims.base import ClaimEvidence, NotTestableError
from cgroup.benchmark.claims.catalog import CLAIMS
from cgroup.benchmark.claims.outcome import Stability
from cgroup.benchmark.claims.verdict import count_tests, decide
from cgroup.benchmark.evidence import Evidence
from cgroup.benchmark.resampling import resample_evidence

if TYPE_CHECKING:
    from collections.abc import Iterable

    import pandas as pd

    from cgroup.benchmark.claims.claim import Claim
    from cgroup.benchmark.claims.outcome import Outcome

RESAMPLES = 200
"""Draws of the pairs that verdicts are checked on, where nothing else is asked for."""


def bootstrap_verdicts(
    frame: pd.DataFrame,
    timing: pd.DataFrame,
    *,
    resamples: int = RESAMPLES,
    seed: int = 0,
    claims: Iterable[Claim] = CLAIMS,
) -> dict[str, Stability]:
    """Find out how often verdicts are the same on other draws of the same pairs.

    A resample draws as many pairs of each data set as it has, with replacement, and all records of a pair
    together; of the times it draws the repeats of each method on each set. It says how much verdicts hang on
    which pairs of these data sets there are, and nothing of other data sets.

    Parameters
    ----------
    frame : DataFrame
        Records, one row per case, method and threshold.
    timing : DataFrame
        Times of the timing experiment; may have no rows.
    resamples : int
        How many; 1 or more.
    seed : int
        Of the draws. The draws of a data set depend on it and on the names of the pairs only, so that
        records of other methods on the same pairs can be compared draw by draw.
    claims : iterable of Claim
        Which; all by default.

    Returns
    -------
    dict of str to Stability
        By the claim's id; only of claims that are testable on all pairs.

    Raises
    ------
    InputError
        If the number of resamples isn't a whole number above 0, or the seed isn't one from 0.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.claims import bootstrap_verdicts
    >>> bootstrap_verdicts(pd.DataFrame(), pd.DataFrame())  # no records
    {}
    """
    evidence = Evidence(frame, timing)
    found: dict[Claim, Outcome] = {claim: decide(claim, evidence).verdict for claim in claims}
    return bootstrap_outcomes(evidence, found, resamples=resamples, seed=seed)


def bootstrap_outcomes(
    evidence: Evidence, found: dict[Claim, Outcome], *, resamples: int = RESAMPLES, seed: int = 0
) -> dict[str, Stability]:
    """Find out how often claims come out as they do on all pairs.

    Parameters
    ----------
    evidence : Evidence
        On all pairs.
    found : dict of Claim to str
        What became of each claim on all pairs.
    resamples, seed : int
        As in `bootstrap_verdicts`.

    Returns
    -------
    dict of str to Stability
        By the claim's id; only of claims that are testable on all pairs.

    Raises
    ------
    InputError
        For numbers that aren't whole or too low.
    """
    resamples, seed = as_count("resamples", resamples, 1), as_count("seed", seed, 0)
    counts: dict[Claim, Counter[Outcome]] = {
        claim: Counter() for claim, outcome in found.items() if outcome != "not testable"
    }
    if not counts:
        return {}
    for resample in resample_evidence(evidence, resamples, seed=seed):
        for claim, count in counts.items():
            count[_find_outcome(claim, resample)] += 1
    return {claim.id: Stability.of(found[claim], count) for claim, count in counts.items()}


def _find_outcome(claim: Claim, evidence: Evidence) -> Outcome:
    try:
        return count_tests(claim.check(ClaimEvidence(evidence))).outcome
    except NotTestableError:
        return "not testable"
