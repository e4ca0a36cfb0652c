"""A statement of the paper, beside the check that decides whether the records bear it out."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import ModuleType

    from cgroup.benchmark.claims.base import ClaimEvidence, Finding

IDS = (*(f"C-{n:02d}" for n in range(1, 30)), "C-29b", *(f"C-{n:02d}" for n in range(30, 68)))
"""Of all claims, in the paper's order."""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper.

    Attributes
    ----------
    id : str
        One of `IDS`.
    section : str
        Of the paper.
    statement : str
        In our own words.
    criterion : str
        What is tested.
    check : callable
        From `ClaimEvidence` to `Finding`; raises `NotTestableError`.

    Examples
    --------
    >>> from cgroup.benchmark.claims import CLAIMS
    >>> len(CLAIMS), CLAIMS[0].id, CLAIMS[0].section
    (68, 'C-01', '4.3, inputs')
    """

    id: str
    section: str
    statement: str
    criterion: str
    check: Callable[[ClaimEvidence], Finding]


def claim(
    id: str,  # noqa: A002 - the name of the field
    *,
    section: str,
    statement: str,
    criterion: str,
) -> Callable[[Callable[[ClaimEvidence], Finding]], Claim]:
    """Make a claim of the check that stands below.

    Parameters
    ----------
    id, section, statement, criterion : str
        Of the `Claim`.

    Returns
    -------
    callable
        Decorator; the name of the check stands for the claim from then on.
    """
    return lambda check: Claim(id, section, statement, criterion, check)


def collect_claims(*modules: ModuleType) -> tuple[Claim, ...]:
    """Collect the claims of some modules.

    Parameters
    ----------
    *modules : module
        In the paper's order, as are the claims in each.

    Returns
    -------
    tuple of Claim
        One for each of `IDS`, in this order.

    Raises
    ------
    ValueError
        If a claim is missing, there twice, unknown, or out of order.
    """
    found = tuple(each for module in modules for each in vars(module).values() if isinstance(each, Claim))
    wanted, there = Counter(IDS), Counter(each.id for each in found)
    if tuple(each.id for each in found) != IDS:
        missing, surplus = list((wanted - there).elements()), list((there - wanted).elements())
        message = (
            "expected each of the claims C-01 to C-67 and C-29b once, in this order; "
            f"missing: {', '.join(missing) or 'none'}; repeated or unknown: {', '.join(surplus) or 'none'}"
        )
        raise ValueError(message)
    return found
