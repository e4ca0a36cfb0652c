"""Is the best pose right? A probability, from what surfaces and matches say of it."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cgroup.verification import Verification

ACCEPTED = 0.5
"""Probability from which a pose is held to be right."""

SURE = 0.9
"""Probability from which no better pose is sought."""

_MOST_MARGIN = 3.0


def probability(found: Verification) -> float:
    """Probability that the best pose is right: a logistic model of score, evidence and margin."""
    score = max(found.score, 1e-6)
    value = math.log(score) + 0.1 * math.log1p(float(found.evidence[0]))
    value += 0.3 * min(max(found.margin, 0.0), _MOST_MARGIN)
    return 1.0 / (1.0 + math.exp(-8.0 * (value + 0.52)))
