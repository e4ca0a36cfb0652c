"""Precision, recall and F (paper, section 4.2), of one group or of many at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_floats, as_mask
from cgroup.errors import InputError
from cgroup.types import BoolArray, FloatArray

REGISTERED_PRECISION = 0.1  # A pair counts as registered when its group's precision is greater than this


class Scores(NamedTuple):
    """Scores of groups, in the shape of their counts; a fraction of nothing is 0."""

    inlier_ratio: FloatArray
    precision: FloatArray
    recall: FloatArray
    f_score: FloatArray
    registered: BoolArray


def score_counts(
    matches: ArrayLike, correct: ArrayLike, selected: ArrayLike, selected_correct: ArrayLike
) -> Scores:
    """Score groups by their counts, all of one shape; NaN counts give NaN scores and are not registered."""
    names = ("matches", "correct", "selected", "selected_correct")
    given = (matches, correct, selected, selected_correct)
    counts = [as_floats(name, count) for name, count in zip(names, given, strict=True)]
    every, right, chosen, hits = counts
    shapes = [count.shape for count in counts]
    if len(set(shapes)) > 1:
        raise InputError(", ".join(names), f"shapes {', '.join(map(str, shapes))}", "give all of one shape")
    precision, recall = divide(hits, chosen), divide(hits, right)
    f_score, registered = harmonic_mean(precision, recall), precision > REGISTERED_PRECISION
    return Scores(divide(right, every), precision, recall, f_score, registered)


@dataclass(frozen=True)
class GroupScore:
    """Counts of a group against the correct matches, and derived scores.

    Attributes
    ----------
    matches, correct : int
        Number of correspondences, and how many are correct.
    selected, selected_correct : int
        Size of the group, and how many in it are correct.
    """

    matches: int
    correct: int
    selected: int
    selected_correct: int

    @property
    def precision(self) -> float:
        """Fraction of the group that is correct; 0 for an empty group."""
        return float(self._scores.precision)

    @property
    def recall(self) -> float:
        """Fraction of the correct matches in the group; 0 without correct matches."""
        return float(self._scores.recall)

    @property
    def f_score(self) -> float:
        """Harmonic mean of precision and recall; 0 if both are."""
        return float(self._scores.f_score)

    @property
    def inlier_ratio(self) -> float:
        """Fraction of all matches that are correct; 0 without matches."""
        return float(self._scores.inlier_ratio)

    @property
    def registered(self) -> bool:
        """Whether precision exceeds 0.1: enough for a robust estimator."""
        return bool(self._scores.registered)

    @cached_property
    def _scores(self) -> Scores:
        return score_counts(self.matches, self.correct, self.selected, self.selected_correct)


def score_group(mask: ArrayLike, correct: ArrayLike) -> GroupScore:
    """Score a group against the correct matches.

    Parameters
    ----------
    mask : (n,) array_like of bool
        The group, such as `Grouping.mask`.
    correct : (n,) array_like of bool
        Correct matches, such as `correct_matches` returns.

    Returns
    -------
    GroupScore
        Counts, from which precision, recall and F follow.

    Examples
    --------
    >>> from cgroup.evaluation import score_group
    >>> score = score_group([True, True, False, False], [True, True, True, False])
    >>> score.precision, round(score.recall, 2)
    (1.0, 0.67)
    """
    group, truth = as_mask("mask", mask), as_mask("correct", correct)
    if len(group) != len(truth):
        raise InputError("mask", f"{len(group)} rows, `correct` has {len(truth)}")
    counts = (len(group), int(truth.sum()), int(group.sum()), int((group & truth).sum()))
    return GroupScore(*counts)


def harmonic_mean(precision: ArrayLike, recall: ArrayLike) -> FloatArray:
    """Return the harmonic means of precisions and recalls; 0 if both are 0."""
    one, other = np.asarray(precision, dtype=np.float64), np.asarray(recall, dtype=np.float64)
    return divide(2 * one * other, one + other)


def divide(part: ArrayLike, whole: ArrayLike) -> FloatArray:
    """Return fractions; 0 if the whole is 0."""
    total = np.asarray(whole, dtype=np.float64)
    with np.errstate(over="ignore", invalid="ignore"):  # counts that are no numbers have no share
        return np.asarray(part, dtype=np.float64) / np.where(total == 0, 1, total)
