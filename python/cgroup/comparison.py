"""Comparison of methods on the same correspondences, against the true pose."""

from __future__ import annotations

import csv
import io
import os
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.values import as_instance, as_items, as_length
from cgroup._runtime.progress import as_stage_function
from cgroup.errors import InputError, NoConsensusError
from cgroup.evaluation import GroupScore, correct_matches, rotation_error, score_group, translation_error
from cgroup.evaluation.ground_truth import CORRECT_WITHIN, mean_displacement
from cgroup.group import check_method, group
from cgroup.io import write_file
from cgroup.registry import METHODS, MethodName
from cgroup.types import BoolArray, Correspondences, FloatArray, Grouping

__all__ = [
    "MAX_DISPLACEMENT", "MAX_ROTATION", "MethodResult", "compare", "find_correct", "table", "write_table",
]  # fmt: skip

MAX_ROTATION = 5.0
"""Default largest rotation error of a registered pair, in degrees."""

MAX_DISPLACEMENT = 5.0
"""Default largest mean displacement of the matched points of a registered pair, in resolutions."""

_SCORES = ("matches", "correct", "selected", "selected_correct", "precision", "recall", "f_score")


@dataclass(frozen=True, eq=False)
class MethodResult:
    """The group and the pose of one method, with their scores.

    Attributes
    ----------
    method : str
        Public name.
    grouping : Grouping
        Its group.
    score : GroupScore
        Precision, recall, F; `registered`: whether precision exceeds 0.1.
    T_target_source : (4,4) array of float64, optional
        Least-squares pose of the group, if there is one.
    rotation_error, translation_error : float
        Errors of that pose, in degrees and in the data's unit; NaN without a pose.
    displacement : float
        Mean distance of the matched source points between that pose and the true one, in the data's unit; NaN
        without a pose.
    registered : bool
        Whether rotation error and displacement are within the limits.
    seconds : float
        Wall time of the grouping alone.
    """

    method: str
    grouping: Grouping
    score: GroupScore
    T_target_source: FloatArray | None
    rotation_error: float
    translation_error: float
    displacement: float
    registered: bool
    seconds: float


def compare(
    correspondences: Correspondences,
    T_target_source: ArrayLike,
    *,
    methods: Iterable[MethodName | str] = tuple(METHODS),
    tolerance: float | None = None,
    correct: ArrayLike | None = None,
    max_rotation: float = MAX_ROTATION,
    max_displacement: float | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Iterator[MethodResult]:
    """Run methods on the same matches; further parameters as for `find_correct`.

    Parameters
    ----------
    methods : iterable of str
        Names from `METHODS`, in any case; all by default.
    correct : (n,) array_like of bool, optional
        Which correspondences are correct, instead of by `tolerance`.
    max_rotation : float
        Largest rotation error of a registered pair, in degrees.
    max_displacement : float, optional
        Largest mean displacement of the matched source points of a registered pair, in the data's unit; the
        tolerance if given, else 5 times the resolution.
    progress : callable, optional
        Called with the name of each method as it begins.

    Yields
    ------
    MethodResult
        As each method ends.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.comparison import compare
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 200)
    >>> matches, pose = problem.correspondences(), problem.T_target_source
    >>> results = compare(matches, pose, methods=["gc", "gtm"])
    >>> {result.method: result.registered for result in results}
    {'gc': True, 'gtm': True}
    """
    as_instance("correspondences", correspondences, Correspondences)
    names = [check_method(method) for method in as_items("methods", methods, "give names from METHODS")]
    begin, max_rotation = as_stage_function(progress), as_length("max_rotation", max_rotation)
    if correct is None:
        correct = find_correct(correspondences, T_target_source, tolerance=tolerance)
    if max_displacement is None:
        max_displacement = tolerance
    if max_displacement is None:
        max_displacement = MAX_DISPLACEMENT * _need_resolution(correspondences, "max_displacement")
    truth, flags = np.asarray(T_target_source), np.asarray(correct)
    limits = max_rotation, as_length("max_displacement", max_displacement)
    for method in names:
        begin(method)
        yield _run_method(correspondences, method, truth, flags, limits)


def find_correct(
    correspondences: Correspondences, T_target_source: ArrayLike, *, tolerance: float | None = None
) -> BoolArray:
    """Return the mask of the correct correspondences.

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
        Whether the distance under the true pose is within the tolerance.
    """
    if tolerance is None:
        tolerance = CORRECT_WITHIN * _need_resolution(correspondences, "tolerance")
    points = correspondences.source, correspondences.target
    return correct_matches(*points, T_target_source, tolerance=tolerance)


def _need_resolution(correspondences: Correspondences, name: str) -> float:
    if correspondences.resolution is None:
        raise InputError(name, remedy="needed without a resolution; give it, or the resolution")
    return correspondences.resolution


def _run_method(
    correspondences: Correspondences,
    method: str,
    truth: FloatArray,
    correct: BoolArray,
    limits: tuple[float, float],
) -> MethodResult:
    """Run one method and score it; limits are those of rotation and displacement."""
    start = time.perf_counter()
    grouping = group(correspondences, method)
    seconds = time.perf_counter() - start
    score = score_group(grouping.mask, correct)
    try:
        pose = grouping.transform()
    except NoConsensusError:
        return MethodResult(method, grouping, score, None, *[np.nan] * 3, registered=False, seconds=seconds)
    angle, shift = rotation_error(pose, truth), translation_error(pose, truth)
    displacement = mean_displacement(correspondences.source, pose, truth)
    registered = angle <= limits[0] and displacement <= limits[1]
    return MethodResult(method, grouping, score, pose, angle, shift, displacement, registered, seconds)


def table(results: Iterable[MethodResult]) -> list[dict[str, str | int | float | bool]]:
    """Return results as rows of plain values, for files and data frames.

    Parameters
    ----------
    results : iterable of MethodResult
        One row each.

    Returns
    -------
    list of dict
        Method, counts, scores, both criteria, pose errors (degrees; the data's unit) and milliseconds.
    """
    return [
        {
            "method": result.method, **{name: getattr(result.score, name) for name in _SCORES},
            "precision_above_0.1": result.score.registered, "registered": result.registered,
            "rotation_error_deg": result.rotation_error, "translation_error": result.translation_error,
            "displacement": result.displacement, "milliseconds": result.seconds * 1e3,
        }
        for result in results
    ]  # fmt: skip


def write_table(path: str | os.PathLike[str], results: Iterable[MethodResult]) -> None:
    """Write the results as CSV with one header line.

    They are as for `table`, and the path is as for `write_cloud`.
    """
    rows = table(results)
    if not rows:
        raise InputError("results", "none", "give the results of one method or more")
    text = io.StringIO()
    writer = csv.DictWriter(text, fieldnames=list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_file(path, text.getvalue().encode())
