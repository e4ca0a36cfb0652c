"""Several methods on the same correspondences, each judged against the true pose."""

from __future__ import annotations

import csv
import io
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cgroup.errors import InputError, NoConsensusError
from cgroup.evaluation import correct_matches, rotation_error, score_group, translation_error
from cgroup.evaluation.ground_truth import CORRECT_WITHIN
from cgroup.group import group
from cgroup.io import write_file
from cgroup.registry import METHODS

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Iterator
    from typing import Any

    from numpy.typing import ArrayLike

    from cgroup.evaluation import GroupScore
    from cgroup.types import BoolArray, Correspondences, FloatArray, Grouping


@dataclass(frozen=True, eq=False)
class MethodResult:
    """What one method made of the correspondences, and how good that is.

    Attributes
    ----------
    method : str
        Public name.
    grouping : Grouping
        What it selected.
    score : GroupScore
        Precision, recall, F, whether the pair is registered.
    T_target_source : (4,4) array of float64, optional
        Least-squares pose of the group; None if the group fixes none.
    rotation_error : float
        Of that pose, in degrees; NaN without a pose.
    translation_error : float
        Of that pose, in the data's unit; NaN without a pose.
    seconds : float
        Wall time of the grouping alone.
    """

    method: str
    grouping: Grouping
    score: GroupScore
    T_target_source: FloatArray | None
    rotation_error: float
    translation_error: float
    seconds: float


def compare(
    correspondences: Correspondences,
    T_target_source: ArrayLike,
    *,
    methods: Iterable[str] = tuple(METHODS),
    tolerance: float | None = None,
    correct: ArrayLike | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Iterator[MethodResult]:
    """Run methods one after another on the same correspondences.

    Parameters
    ----------
    correspondences : Correspondences
        With every field that the methods need.
    T_target_source : (4,4) array_like of float
        True pose.
    methods : iterable of str
        Names from `METHODS`; all by default.
    tolerance : float, optional
        As in `find_correct`.
    correct : (n,) array_like of bool, optional
        Which correspondences are correct, where that is known already; `tolerance` doesn't matter then.
    progress : callable, optional
        Called with the name of each method as it begins.

    Yields
    ------
    MethodResult
        As each method ends.

    Raises
    ------
    InputError
        If a field or the resolution is missing, or the pose isn't rigid.
    """
    if correct is None:
        correct = find_correct(correspondences, T_target_source, tolerance=tolerance)
    truth, pose = np.asarray(correct), np.asarray(T_target_source)
    for method in methods:
        if progress is not None:
            progress(method)
        yield _run_method(correspondences, method, truth, pose)


def find_correct(
    correspondences: Correspondences, T_target_source: ArrayLike, *, tolerance: float | None = None
) -> BoolArray:
    """Find the correspondences that are correct.

    Parameters
    ----------
    correspondences : Correspondences
        With a resolution, unless the tolerance is given.
    T_target_source : (4,4) array_like of float
        True pose.
    tolerance : float, optional
        Largest distance of a correct match from its true place, in the data's unit; 5 times the
        resolution by default.

    Returns
    -------
    (n,) array of bool
        As `cgroup.evaluation.correct_matches` gives it.

    Raises
    ------
    InputError
        If neither tolerance nor resolution is known, or the pose isn't rigid.
    """
    if tolerance is None:
        if correspondences.resolution is None:
            message = "tolerance: needed to tell correct matches where no resolution is known"
            raise InputError(message)
        tolerance = CORRECT_WITHIN * correspondences.resolution
    return correct_matches(
        correspondences.source, correspondences.target, T_target_source, tolerance=tolerance
    )


def _run_method(
    correspondences: Correspondences, method: str, correct: BoolArray, true_pose: FloatArray
) -> MethodResult:
    start = time.perf_counter()
    grouping = group(correspondences, method)
    seconds = time.perf_counter() - start
    score = score_group(grouping.mask, correct)
    try:
        pose = grouping.transform()
    except NoConsensusError:
        return MethodResult(method, grouping, score, None, np.nan, np.nan, seconds)
    angle, shift = rotation_error(pose, true_pose), translation_error(pose, true_pose)
    return MethodResult(method, grouping, score, pose, angle, shift, seconds)


def table(results: Iterable[MethodResult]) -> list[dict[str, str | int | float | bool]]:
    """List the results as rows of plain values, for files and data frames.

    Parameters
    ----------
    results : iterable of MethodResult
        One row each.

    Returns
    -------
    list of dict
        Method, counts, scores, pose errors (degrees; the data's unit) and milliseconds.
    """
    return [
        {
            "method": result.method,
            "matches": result.score.matches,
            "correct": result.score.correct,
            "selected": result.score.selected,
            "selected_correct": result.score.selected_correct,
            "precision": result.score.precision,
            "recall": result.score.recall,
            "f_score": result.score.f_score,
            "registered": result.score.registered,
            "rotation_error_deg": result.rotation_error,
            "translation_error": result.translation_error,
            "milliseconds": result.seconds * 1e3,
        }
        for result in results
    ]


def write_table(path: str | os.PathLike[str], results: Iterable[MethodResult]) -> None:
    """Write the results as CSV with one header line.

    Parameters
    ----------
    path : path-like
        File to write.
    results : iterable of MethodResult
        One row each, at least one.

    Raises
    ------
    InputError
        If the file can't be written.
    """
    rows = table(results)
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_file(path, text.getvalue().encode())
