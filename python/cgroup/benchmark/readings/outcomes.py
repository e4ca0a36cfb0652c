"""What comes of the paper's claims under each reading."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cgroup._checks.values import as_count
from cgroup._runtime.progress import ignore_progress
from cgroup.benchmark.claims import CLAIMS, OUTCOMES, RESAMPLES, check_claims, check_evidence, count_verdicts
from cgroup.benchmark.claims.stability import bootstrap_outcomes
from cgroup.benchmark.evidence import Evidence
from cgroup.benchmark.readings.measurement import measure_again
from cgroup.benchmark.readings.selection import (
    find_average,
    select_default,
    select_reading,
    select_times,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path
    from typing import Any

    import pandas as pd

    from cgroup.benchmark.claims import Claim, Outcome, Verdict
    from cgroup.benchmark.readings.reading import Reading

DEFAULT = "default"
"""Name of the reading that is none."""


@dataclass(frozen=True)
class ReadingOutcome:
    """Verdicts under one reading.

    Attributes
    ----------
    name, label : str
        Of the reading.
    verdicts : dict of str to Verdict
        By claim, in the paper's order, with their stability.
    moved : frozenset of str
        Claims of which a number that is quoted, or the data, is another than under the default.
    better, worse : tuple of str
        Claims whose verdict is better than under the default, and worse; without those that are not
        testable under one of both.

    Examples
    --------
    >>> import pandas as pd
    >>> from cgroup.benchmark.readings import judge_readings
    >>> (default,) = judge_readings(pd.DataFrame(), pd.DataFrame(), [])  # no records
    >>> default.name, default.counts["not testable"], default.is_close("C-01")
    ('default', 68, False)
    """

    name: str
    label: str
    verdicts: dict[str, Verdict]
    moved: frozenset[str] = frozenset()
    better: tuple[str, ...] = ()
    worse: tuple[str, ...] = ()

    @property
    def counts(self) -> dict[str, int]:
        """How many claims have which verdict.

        Examples
        --------
        >>> from cgroup.benchmark.readings import ReadingOutcome
        >>> ReadingOutcome("none", "", {}).counts
        {'confirmed': 0, 'partly': 0, 'not confirmed': 0, 'not testable': 0}
        """
        return count_verdicts(self.verdicts.values())

    def is_close(self, claim: str) -> bool:
        """Tell whether another draw of the pairs would often give another verdict.

        Parameters
        ----------
        claim : str
            Id of a claim.

        Returns
        -------
        bool
            Also False where the claim is not testable.

        Examples
        --------
        >>> from cgroup.benchmark.readings import ReadingOutcome
        >>> import pandas as pd
        >>> from cgroup.benchmark.readings import judge_readings
        >>> (default,) = judge_readings(pd.DataFrame(), pd.DataFrame(), [])  # no records
        >>> default.is_close("C-01")
        False
        """
        stability = self.verdicts[claim].stability
        return stability is not None and stability.close


def judge_readings(
    frame: pd.DataFrame,
    timing: pd.DataFrame,
    readings: Sequence[Reading],
    *,
    root: Path | None = None,
    resamples: int = RESAMPLES,
    progress: Callable[[str, int, int], Any] | None = None,
) -> list[ReadingOutcome]:
    """Check the paper's claims on the records of every reading.

    Parameters
    ----------
    frame : DataFrame
        Records of a configuration from `add_readings`.
    timing : DataFrame
        Times of the timing experiment; may have no rows.
    readings : sequence of Reading
        What was tried.
    root : Path, optional
        Folder that holds the data sets' folders, by default that in the environment variable ``CGROUP_DATA``;
        needed where facts about pairs are measured again.
    resamples : int
        Draws of the bootstrap, for each reading the same.
    progress : callable, optional
        Called with "judge" and how many of how many readings are done.

    Returns
    -------
    list of ReadingOutcome
        The default's first, then in the order of the readings.

    Raises
    ------
    InputError
        If the number of resamples isn't a whole number above 0, or a pair that is to be measured again isn't
        there any more.

    Examples
    --------
    >>> from pathlib import Path
    >>> from cgroup.benchmark import tables
    >>> from cgroup.benchmark.config import Config
    >>> from cgroup.benchmark.readings import (
    ...     add_readings,
    ...     judge_readings,
    ...     list_readings,
    ... )
    >>> from cgroup.benchmark.run import run
    >>> small = {"id": "clutter", "dataset": "standin-clutter", "pairs": 1}
    >>> base = Config(name="mine", methods=["gc", "gtm"], experiment=[small])
    >>> readings = list_readings(["gtm-20"])
    >>> _ = run(add_readings(base, readings), Path("results"), backend="threading")
    >>> frame, timing = (
    ...     tables.load(Path("results"), kind) for kind in ("experiment", "timing")
    ... )
    >>> [
    ...     outcome.name
    ...     for outcome in judge_readings(frame, timing, readings, resamples=1)
    ... ]
    ['default', 'gtm-20']
    """
    tell, resamples = progress or ignore_progress, as_count("resamples", resamples, 1)
    tell("judge", 0, 1 + len(readings))
    default = check_claims(select_default(frame), select_times(timing), resamples=resamples)
    before = {verdict.id: verdict for verdict in default}
    outcomes = [ReadingOutcome(DEFAULT, "", before)]
    for reading in readings:
        tell("judge", len(outcomes), 1 + len(readings))
        chosen, times = select_reading(frame, reading), select_times(timing, reading)
        evidence = Evidence(measure_again(chosen, reading, root), times, average=find_average(reading))
        outcomes.append(_judge(evidence, reading, before, resamples))
    tell("judge", len(outcomes), len(outcomes))
    return outcomes


def _judge(
    evidence: Evidence, reading: Reading, before: dict[str, Verdict], resamples: int
) -> ReadingOutcome:
    verdicts = {verdict.id: verdict for verdict in check_evidence(evidence)}
    moved = [claim for claim in CLAIMS if _numbers(verdicts[claim.id]) != _numbers(before[claim.id])]
    change = {claim.id: _count_steps(before[claim.id], verdicts[claim.id]) for claim in moved}
    found: dict[Claim, Outcome] = {claim: verdicts[claim.id].verdict for claim in moved}
    drawn = bootstrap_outcomes(evidence, found, resamples=resamples)
    known = {claim: drawn.get(claim) if claim in change else before[claim].stability for claim in verdicts}
    return ReadingOutcome(
        reading.name,
        reading.label,
        {claim: replace(verdict, stability=known[claim]) for claim, verdict in verdicts.items()},
        frozenset(change),
        tuple(claim for claim, steps in change.items() if steps > 0),
        tuple(claim for claim, steps in change.items() if steps < 0),
    )


def _numbers(verdict: Verdict) -> tuple[str, str]:
    return verdict.measured, verdict.data


def _count_steps(before: Verdict, after: Verdict) -> int:
    """By how many steps a verdict is better than before; 0 where one of both is not testable."""
    if "not testable" in {before.verdict, after.verdict}:
        return 0
    return OUTCOMES.index(before.verdict) - OUTCOMES.index(after.verdict)
