"""Quality of a group against the ground truth (paper 4.2, Eq. 19 to 21).

Decisions where the paper is open
---------------------------------
* Empty group: precision 0. No correct correspondence at all: recall 0. Both 0: F = 0.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .result import BoolArray, as_points

REGISTERED = 0.1


@dataclass(frozen=True)
class Quality:
    """Precision, recall and F-score of one group, with the counts behind them."""

    precision: float
    recall: float
    f_score: float
    n_group: int
    n_group_correct: int
    n_correct: int

    @property
    def registered(self) -> bool:
        """True when the precision suffices for registration (tau_reg = 0.1, strict)."""
        return self.precision > REGISTERED


def correct_correspondences(
    source: ArrayLike, target: ArrayLike, T_target_source: ArrayLike, tolerance: float
) -> BoolArray:
    """(n,) True where |R p + t - p'| <= tolerance, Eq. 19."""
    transform = np.asarray(T_target_source, dtype=np.float64)
    moved = as_points(source) @ transform[:3, :3].T + transform[:3, 3]
    return np.linalg.norm(moved - as_points(target), axis=1) <= tolerance


def quality(mask: BoolArray, correct: BoolArray) -> Quality:
    """Compare a group with the correct correspondences."""
    n_group, n_correct = int(mask.sum()), int(correct.sum())
    n_group_correct = int((mask & correct).sum())
    precision = n_group_correct / n_group if n_group else 0.0  # Eq. 20
    recall = n_group_correct / n_correct if n_correct else 0.0  # Eq. 21
    total = precision + recall
    f_score = 2.0 * precision * recall / total if total else 0.0
    return Quality(precision, recall, f_score, n_group, n_group_correct, n_correct)
