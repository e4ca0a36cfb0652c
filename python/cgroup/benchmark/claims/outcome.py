"""What can become of a claim, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Mapping

Outcome: TypeAlias = Literal["confirmed", "partly", "not confirmed", "not testable"]

OUTCOMES: tuple[Outcome, ...] = ("confirmed", "partly", "not confirmed", "not testable")

CLOSE = 0.1
"""A verdict is close if it changes in a larger share of the resamples."""


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
    >>> from cgroup.benchmark.claims import Stability
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
        >>> from cgroup.benchmark.claims import Stability
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
