"""Precision, recall and F of a group, and their means over many pairs (paper, section 4.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from cgroup.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import ArrayLike

REGISTERED_PRECISION = 0.1
"""A pair counts as registered when its group's precision is greater than this."""


@dataclass(frozen=True)
class GroupScore:
    """How a group compares with the matches that are correct.

    Attributes
    ----------
    matches : int
        Correspondences that the method was given.
    correct : int
        How many of those are correct.
    selected : int
        Size of the group.
    selected_correct : int
        How many in the group are correct.
    """

    matches: int
    correct: int
    selected: int
    selected_correct: int

    @property
    def precision(self) -> float:
        """Share of the group that is correct; 0 for an empty group."""
        return _ratio(self.selected_correct, self.selected)

    @property
    def recall(self) -> float:
        """Share of the correct matches that the group holds; 0 if there are none."""
        return _ratio(self.selected_correct, self.correct)

    @property
    def f_score(self) -> float:
        """Harmonic mean of precision and recall; 0 if both are."""
        return harmonic_mean(self.precision, self.recall)

    @property
    def inlier_ratio(self) -> float:
        """Share of all matches that is correct; 0 if there are no matches."""
        return _ratio(self.correct, self.matches)

    @property
    def registered(self) -> bool:
        """Whether precision exceeds `REGISTERED_PRECISION`: enough for a robust estimator."""
        return self.precision > REGISTERED_PRECISION


@dataclass(frozen=True)
class ScoreMeans:
    """Scores of one method over many pairs.

    Attributes
    ----------
    pairs : int
        Pairs that were counted.
    precision, recall, f_score : float
        Means over the pairs, each pair with the same weight; NaN if no pair defines the value.
    f_of_means : float
        F of mean precision and mean recall.
    pooled : GroupScore
        All pairs taken as one: matches with the same weight.
    registered : float
        Share of the pairs that are registered.
    """

    pairs: int
    precision: float
    recall: float
    f_score: float
    f_of_means: float
    pooled: GroupScore
    registered: float


def score_group(mask: ArrayLike, correct: ArrayLike) -> GroupScore:
    """Compare a group with the matches that are correct.

    Parameters
    ----------
    mask : (n,) array_like of bool
        The group, as in `Grouping.mask`.
    correct : (n,) array_like of bool
        See `correct_matches`.

    Returns
    -------
    GroupScore
        Counts, from which precision, recall and F follow.

    Raises
    ------
    InputError
        If the two are not vectors of bool of equal length.
    """
    group, truth = np.asarray(mask), np.asarray(correct)
    for name, array in (("mask", group), ("correct", truth)):
        if array.dtype != bool or array.ndim != 1:
            message = f"{name}: got {array.dtype} of shape {array.shape}; give a vector of bool"
            raise InputError(message)
    if len(group) != len(truth):
        message = f"mask: got {len(group)} rows, `correct` has {len(truth)}"
        raise InputError(message)
    counts = (len(group), int(truth.sum()), int(group.sum()), int((group & truth).sum()))
    return GroupScore(*counts)


def harmonic_mean(precision: float, recall: float) -> float:
    """F of precision and recall; 0 if both are 0."""
    total = precision + recall
    return 2 * precision * recall / total if total > 0 else 0.0


def mean_scores(
    scores: Iterable[GroupScore],
    *,
    undefined: Literal["zero", "skip"] = "zero",
    min_correct: int = 0,
) -> ScoreMeans:
    """Average over pairs.

    The paper doesn't say how it averages; each pair has the same weight here.

    Parameters
    ----------
    scores : iterable of GroupScore
        One per pair.
    undefined : {"zero", "skip"}
        Precision of an empty group and recall without a correct match count as 0, or are left out
        of the mean of that value (and of F, if either is undefined).
    min_correct : int
        Pairs with fewer correct matches are left out altogether.

    Returns
    -------
    ScoreMeans
        Means, pooled counts and registration rate.

    Raises
    ------
    InputError
        If `undefined` is neither of the two, or no pair is left.
    """
    if undefined not in {"zero", "skip"}:
        message = f"undefined: got {undefined!r}; choose 'zero' or 'skip'"
        raise InputError(message)
    kept = [score for score in scores if score.correct >= min_correct]
    if not kept:
        message = f"scores: no pair has at least {min_correct} correct matches"
        raise InputError(message)
    every = undefined == "zero"
    precision = _mean([s.precision for s in kept if every or s.selected > 0])
    recall = _mean([s.recall for s in kept if every or s.correct > 0])
    return ScoreMeans(
        pairs=len(kept),
        precision=precision,
        recall=recall,
        f_score=_mean([s.f_score for s in kept if every or (s.selected > 0 and s.correct > 0)]),
        f_of_means=harmonic_mean(precision, recall),
        pooled=GroupScore(
            sum(s.matches for s in kept),
            sum(s.correct for s in kept),
            sum(s.selected for s in kept),
            sum(s.selected_correct for s in kept),
        ),
        registered=_mean([float(s.registered) for s in kept]),
    )


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole > 0 else 0.0


def _mean(values: list[float]) -> float:
    return sum(values) / len(values) if values else float("nan")
