"""Explanations why each match was kept or dropped: the rule of the method, and the other matches."""

from collections.abc import Iterable

import numpy as np

from cgroup._checks.values import as_count
from cgroup._explain.rules import Facts, judge
from cgroup.errors import InputError
from cgroup.explanation import Explanation
from cgroup.types import Grouping

__all__ = ["explain_match", "explain_matches"]


def explain_match(grouping: Grouping, index: int) -> Explanation:
    """Explain one match, for `Grouping.explain`."""
    row, count = as_count("index", index, 0), len(grouping.mask)
    if row >= count:
        known = f"there are {count}, from 0 to {count - 1}" if count else "there are none"
        raise InputError("index", row, f"give the row of a match: {known}")
    return _explain(Facts(grouping), row)


def explain_matches(grouping: Grouping, rows: Iterable[int]) -> list[Explanation]:
    """Explain the matches of some rows; common facts are computed once."""
    facts = Facts(grouping)
    return [_explain(facts, row) for row in rows]


def _explain(facts: Facts, row: int) -> Explanation:
    grouping, verdict, agreeing = facts.grouping, judge(facts, row), facts.agreeing(row)
    return Explanation(
        index=row, kept=bool(grouping.mask[row]), matches=len(grouping.mask), selected=grouping.size,
        method=None if facts.rule is None else facts.rule.method,
        score=None if grouping.scores is None else float(grouping.scores[row]), rank=facts.rank(row),
        residual=None if facts.residuals is None else float(facts.residuals[row]),
        threshold=verdict.threshold, tolerance=verdict.tolerance, resolution=facts.resolution,
        agreeing=None if agreeing is None else int(np.count_nonzero(agreeing)),
        agreeing_in_group=None if agreeing is None else int(np.count_nonzero(agreeing & grouping.mask)),
        agreement="" if facts.points is None else facts.agreement_text,
        reason=verdict.reason, remedy=verdict.remedy, _tells_residual=verdict.tells_residual,
    )  # fmt: skip
