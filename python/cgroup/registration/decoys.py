"""Estimated number of wrong poses among accepted ones, from mirrored scans."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_instance, as_items
from cgroup.registration.judge import is_accepted
from cgroup.registration.result import Registration

_QUANTILE = 1.959964  # of the standard normal distribution, for 95 %
_TOO_FEW = 50.0  # upper end of an interval, in %, from which the share is unknown


@dataclass(frozen=True)
class FalseAccepts:
    """Estimated share of wrong poses among the accepted poses of a list.

    Attributes
    ----------
    pairs, accepted, decoys : int
        Numbers of results, of accepted poses, and of mirrored sources that would have been accepted.
    share : float
        `decoys` over `accepted`, at most 1; NaN if none is accepted.
    interval : tuple of float
        Interval of the share, 95 %: that of a Poisson count (Byar's approximation), over `accepted`.
    """

    pairs: int
    accepted: int
    decoys: int
    share: float
    interval: tuple[float, float]

    def __str__(self) -> str:
        if not self.accepted:
            return f"none of {self.pairs} poses accepted"
        low, high = (100 * bound for bound in self.interval)
        share = (
            f"about {100 * self.share:.3g} % ({low:.3g} to {high:.3g} %)"
            if high < _TOO_FEW
            else "an unknown number"
        )
        wrong = f"{share} of {self.accepted} accepted poses are wrong"
        return f"{wrong}: {self.decoys} of {self.pairs} mirrored sources would be accepted"


@explain_wrong_calls
def false_accepts(results: Iterable[Registration | None]) -> FalseAccepts:
    """Estimate how many of the accepted poses of a list are wrong.

    A mirrored source has no right pose, but chance aligns it as well as the source. So about as many wrong
    poses are accepted as mirrored sources would be, each against the best pose of its pair (target-decoy
    competition; Elias and Gygi, Nature Methods 2007), if no scan is the mirror image of another.

    Parameters
    ----------
    results : iterable of Registration or None
        Results of `register` or `register_many`, accepted or not. Include all refused ones: without them the
        estimate is too low. Results without a search (`initial`, own `matches`, None) do not count.

    Returns
    -------
    FalseAccepts
        The counts, and the estimated share of wrong poses.

    Raises
    ------
    InputError
        For another type in `results`.

    Examples
    --------
    >>> from cgroup.registration import false_accepts
    >>> print(false_accepts([]))
    none of 0 poses accepted
    """
    given = [one for one in as_items("results", results, "give results of `register`") if one is not None]
    given = [as_instance("results", one, Registration) for one in given]
    found = [(one.ok, one.decoy_probability) for one in given if one.decoy_probability is not None]
    return count_false_accepts([ok for ok, _ in found], [is_accepted(decoy) for _, decoy in found])


def count_false_accepts(accepted: Iterable[bool], decoys: Iterable[bool]) -> FalseAccepts:
    """Return the estimate for the accepted poses and the accepted mirrored sources of some pairs."""
    all_of, wrong = list(accepted), sum(decoys)
    yes = sum(all_of)
    bounds = [min(1.0, bound / yes) if yes else math.nan for bound in (wrong, *_poisson(wrong))]
    return FalseAccepts(len(all_of), yes, wrong, bounds[0], (bounds[1], bounds[2]))


def _poisson(count: int) -> tuple[float, float]:
    """Return the 95 % interval of the mean of a Poisson count."""
    low = count * (1 - 1 / (9 * count) - _QUANTILE / (3 * math.sqrt(count))) ** 3 if count else 0.0
    return low, (count + 1) * (1 - 1 / (9 * count + 9) + _QUANTILE / (3 * math.sqrt(count + 1))) ** 3
