"""Precision, recall and F (paper, section 4.2), of one group or of many at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup._checks.arrays import as_floats, as_mask
from cgroup.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.types import BoolArray, FloatArray

REGISTERED_PRECISION = 0.1
"""A pair counts as registered when its group's precision is greater than this."""


class Scores(NamedTuple):
    """Scores that follow from counts; one value per group, or a single one.

    Attributes
    ----------
    inlier_ratio : array of float64
        Share of all matches that is correct; 0 if there are no matches.
    precision : array of float64
        Share of the group that is correct; 0 for an empty group.
    recall : array of float64
        Share of the correct matches that the group holds; 0 if there are none.
    f_score : array of float64
        Harmonic mean of precision and recall; 0 if both are.
    registered : array of bool
        Whether precision exceeds `REGISTERED_PRECISION`: enough for a robust estimator.

    Examples
    --------
    >>> from cgroup.evaluation import score_counts
    >>> score_counts([10, 10], [4, 4], [5, 0], [3, 0]).precision
    array([0.6, 0. ])
    """

    inlier_ratio: FloatArray
    precision: FloatArray
    recall: FloatArray
    f_score: FloatArray
    registered: BoolArray


def score_counts(
    matches: ArrayLike, correct: ArrayLike, selected: ArrayLike, selected_correct: ArrayLike
) -> Scores:
    """Score groups by their counts.

    Parameters
    ----------
    matches, correct : array_like of int
        Correspondences that a method was given, of each group, and how many are correct; NaN where not known.
    selected, selected_correct : array_like of int
        Size of the group, and how many in it are correct. All four are of one shape.

    Returns
    -------
    Scores
        In that shape; NaN, and not registered, where a count is NaN.

    Raises
    ------
    InputError
        If they aren't numbers, or not of one shape.

    Examples
    --------
    >>> from cgroup.evaluation import score_counts
    >>> float(score_counts(100, 20, 16, selected_correct=12).precision)
    0.75
    """
    names = ("matches", "correct", "selected", "selected_correct")
    given = (matches, correct, selected, selected_correct)
    counts = [as_floats(name, count) for name, count in zip(names, given, strict=True)]
    every, right, chosen, hits = counts
    shapes = [count.shape for count in counts]
    if len(set(shapes)) > 1:
        raise InputError(", ".join(names), f"shapes {', '.join(map(str, shapes))}", "give all of one shape")
    precision, recall = divide(hits, chosen), divide(hits, right)
    return Scores(
        inlier_ratio=divide(right, every),
        precision=precision,
        recall=recall,
        f_score=harmonic_mean(precision, recall),
        registered=precision > REGISTERED_PRECISION,
    )


@dataclass(frozen=True)
class GroupScore:
    """How a group compares with the matches that are correct.

    Attributes
    ----------
    matches, correct : int
        Correspondences that the method was given, and how many are correct.
    selected, selected_correct : int
        Size of the group, and how many in it are correct.

    Examples
    --------
    >>> from cgroup.evaluation import score_group
    >>> score_group(mask=[True, True, False], correct=[True, False, True])
    GroupScore(matches=3, correct=2, selected=2, selected_correct=1)
    """

    matches: int
    correct: int
    selected: int
    selected_correct: int

    @property
    def precision(self) -> float:
        """Share of the group that is correct; 0 for an empty group.

        Examples
        --------
        >>> from cgroup.evaluation import GroupScore
        >>> GroupScore(100, 20, 16, selected_correct=12).precision
        0.75
        """
        return float(self._scores.precision)

    @property
    def recall(self) -> float:
        """Share of the correct matches that the group holds; 0 if there are none.

        Examples
        --------
        >>> from cgroup.evaluation import GroupScore
        >>> GroupScore(100, 20, 16, selected_correct=12).recall
        0.6
        """
        return float(self._scores.recall)

    @property
    def f_score(self) -> float:
        """Harmonic mean of precision and recall; 0 if both are.

        Examples
        --------
        >>> from cgroup.evaluation import GroupScore
        >>> round(GroupScore(100, 20, 16, selected_correct=12).f_score, 3)
        0.667
        """
        return float(self._scores.f_score)

    @property
    def inlier_ratio(self) -> float:
        """Share of all matches that is correct; 0 if there are no matches.

        Examples
        --------
        >>> from cgroup.evaluation import GroupScore
        >>> GroupScore(100, 20, 16, selected_correct=12).inlier_ratio
        0.2
        """
        return float(self._scores.inlier_ratio)

    @property
    def registered(self) -> bool:
        """Whether precision exceeds 0.1: enough for a robust estimator.

        Examples
        --------
        >>> from cgroup.evaluation import GroupScore
        >>> GroupScore(100, 20, 16, selected_correct=12).registered
        True
        """
        return bool(self._scores.registered)

    @cached_property
    def _scores(self) -> Scores:
        return score_counts(self.matches, self.correct, self.selected, self.selected_correct)


def score_group(mask: ArrayLike, correct: ArrayLike) -> GroupScore:
    """Compare a group with the matches that are correct.

    Parameters
    ----------
    mask : (n,) array_like of bool
        The group: True for the matches in it, such as `Grouping.mask`.
    correct : (n,) array_like of bool
        True for the matches that are correct, such as `correct_matches` returns.

    Returns
    -------
    GroupScore
        Counts, from which precision, recall and F follow.

    Raises
    ------
    InputError
        If the two are not vectors of bool of equal length.

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
    """F of precision and recall, value by value; 0 where both are 0."""
    one, other = np.asarray(precision, dtype=np.float64), np.asarray(recall, dtype=np.float64)
    return divide(2 * one * other, one + other)


def divide(part: ArrayLike, whole: ArrayLike) -> FloatArray:
    """Share of a part in a whole, value by value; 0 where the whole is 0."""
    total = np.asarray(whole, dtype=np.float64)
    with np.errstate(over="ignore", invalid="ignore"):  # counts that are no numbers have no share
        return np.asarray(part, dtype=np.float64) / np.where(total == 0, 1, total)
