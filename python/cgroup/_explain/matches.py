"""From a group to what is said of its matches."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup._checks.values import as_count
from cgroup._explain.facts import Facts
from cgroup._explain.rules import judge
from cgroup.errors import InputError
from cgroup.explanation import Explanation

if TYPE_CHECKING:
    from collections.abc import Iterable

    from cgroup.types import Grouping


def explain_match(grouping: Grouping, index: int) -> Explanation:
    """Explain one match: what `Grouping.explain` does."""
    row, count = as_count("index", index, 0), len(grouping.mask)
    if row >= count:
        known = f"there are {count}, from 0 to {count - 1}" if count else "there are none"
        message = f"index: got {row}; give the row of a match: {known}"
        raise InputError(message)
    return _explain(Facts(grouping), row)


def explain_matches(grouping: Grouping, rows: Iterable[int]) -> list[Explanation]:
    """Explain several matches, with what they have in common computed once.

    Parameters
    ----------
    grouping : Grouping
        What a method selected.
    rows : iterable of int
        Which matches.

    Returns
    -------
    list of Explanation
        In the order of the rows.

    Raises
    ------
    InputError
        If there is no such row.

    Examples
    --------
    >>> from cgroup import ss
    >>> from cgroup._explain import explain_matches
    >>> [each.kept for each in explain_matches(ss([0.1, 0.9, 0.8]), [0, 1])]
    [False, True]
    """
    facts, count = Facts(grouping), len(grouping.mask)
    chosen = [as_count("rows", row, 0) for row in rows]
    if chosen and max(chosen) >= count:
        message = f"rows: got {max(chosen)}; there are {count} matches"
        raise InputError(message)
    return [_explain(facts, row) for row in chosen]


def _explain(facts: Facts, row: int) -> Explanation:
    grouping, verdict, agreeing = facts.grouping, judge(facts, row), facts.agreeing(row)
    return Explanation(
        index=row,
        kept=bool(grouping.mask[row]),
        method=None if facts.run is None else facts.run.method,
        matches=len(grouping.mask),
        selected=grouping.size,
        score=None if grouping.scores is None else float(grouping.scores[row]),
        rank=facts.rank(row),
        threshold=verdict.threshold,
        residual=None if facts.residuals is None else float(facts.residuals[row]),
        tolerance=verdict.tolerance,
        resolution=facts.resolution,
        agreeing=None if agreeing is None else int(np.count_nonzero(agreeing)),
        agreeing_in_group=None if agreeing is None else int(np.count_nonzero(agreeing & grouping.mask)),
        agreement="" if facts.points is None else facts.rule.text,
        reason=verdict.reason,
        remedy=verdict.remedy,
        _tells_residual=verdict.tells_residual,
    )
