"""Pages of one registration, and of several methods on the same matches."""

from __future__ import annotations

import html
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup._checks.values import as_instance, as_items
from cgroup._show.drawing import as_flags, as_points
from cgroup.comparison import MethodResult, find_correct
from cgroup.errors import InputError
from cgroup.evaluation import rotation_error, translation_error
from cgroup.io import PointCloud
from cgroup.pages.matches import Selection, View, view_page
from cgroup.pages.page import pose_html
from cgroup.registration import Registration
from cgroup.registry import look_up_method
from cgroup.rigid import check_rigid
from cgroup.rigid.transforms import split_scale
from cgroup.types import AnyCloud, Correspondences, FloatArray


def registration_page(
    source: AnyCloud,
    target: AnyCloud,
    registration: Registration,
    *,
    correct: ArrayLike | None = None,
    truth: ArrayLike | None = None,
    title: str = "Registration",
    refusal: str | None = None,
) -> str:
    """Return the page of a registration: both clouds with the matches in a 3D view.

    Parameters
    ----------
    source, target : PointCloud or (N,3) array_like of float
        Registered clouds; at most 20,000 points of each are drawn.
    registration : Registration
        Result of `cgroup.registration.register`, or the guess in the error that it raised.
    correct : (n,) array_like of bool, optional
        Which matches are correct; lines are then green and orange.
    truth : (4,4) array_like of float, optional
        True pose; the page shows the errors of pose and matches.
    title : str
        Plain text.
    refusal : str, optional
        Why the pose was refused: the message of the error.

    Returns
    -------
    str
        HTML, for `write_page`.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.pages import registration_page
    >>> from cgroup.registration import register
    >>> pair = standin_pair(pixels=60)
    >>> found = register(pair.source, pair.target)
    >>> page = registration_page(pair.source, pair.target, found)
    >>> page.startswith("<!doctype html>")
    True
    """
    as_instance("registration", registration, Registration)
    matches, pose = registration.correspondences, registration.T_target_source
    true_pose = None if truth is None else check_rigid(truth, "truth")
    view = View(
        title=as_instance("title", title, str),
        lead=lead_html(registration, refusal),
        source=as_points("source", source),
        target=as_points("target", target),
        colors=(_colors_of(source), _colors_of(target)),
        matches=matches,
        pose=pose,
        correct=None if correct is None else as_flags("correct", correct, len(matches)),
        truth=true_pose,
        selections=[Selection("register", registration.grouping)],
        facts=_facts(registration, true_pose, as_points("source", source)),
        start="joined",
    )
    return view_page(view)


def _colors_of(cloud: AnyCloud) -> NDArray[np.uint8] | None:
    return cloud.colors if isinstance(cloud, PointCloud) else None


def lead_html(
    registration: Registration, refusal: str | None, names: tuple[str, str] = ("source", "target")
) -> str:
    """Make the HTML of a registration's first sentence, or of the reason why it was refused."""
    if refusal is not None:
        why = as_instance("refusal", refusal, str)
        sentence = html.escape(f"{why[:1].upper()}{why[1:].removesuffix('.')}.")
        return f'<p class="refused" role="alert"><b>Refused: this is a guess.</b> {sentence}</p>'
    count = f"{registration.grouping.size:,} of {len(registration.correspondences):,} matches"
    chance = f"The pose is correct with a probability of {registration.probability:.3f}."
    share = f"{100 * registration.fitness:.0f} % of the {names[0]} overlaps the {names[1]}"
    return f'<p class="lead quiet">{chance} {share}; {count} agree with the pose.</p>'


def _facts(registration: Registration, truth: FloatArray | None, source: FloatArray) -> list[tuple[str, str]]:
    pose = registration.T_target_source
    shares = [f"{100 * share:.0f} %" for share in (registration.fitness, registration.target_fitness)]
    facts: list[tuple[str, Any]] = [
        ("pose", pose_html(pose, source)),
        ("probability", f"{registration.probability:.3f} that the pose is correct"),
        ("overlap", f"{shares[0]} of the source overlaps the target, {shares[1]} of the target the source"),
        ("residual", f"{registration.inlier_rmse:.3g} in the overlap (root mean square)"),
        ("voxel", f"{registration.voxel:.4g}"),
    ]
    if truth is not None:
        rigid = split_scale(pose)[1]
        turn, shift = rotation_error(rigid, truth), translation_error(rigid, truth)
        facts.append(("error of the pose", f"{turn:.3g} degrees, {shift:.3g} in translation"))
    return facts + [("note", html.escape(note)) for note in registration.notes]


def comparison_page(
    source: AnyCloud,
    target: AnyCloud,
    correspondences: Correspondences,
    results: Iterable[MethodResult],
    T_target_source: ArrayLike,
    *,
    correct: ArrayLike | None = None,
    tolerance: float | None = None,
    title: str = "Comparison",
) -> str:
    """Return the page of a comparison: the groups of methods, and reasons.

    Further parameters as for `registration_page`, `tolerance` as for `find_correct`.

    Parameters
    ----------
    correspondences : Correspondences
        The matches that were grouped.
    results : iterable of MethodResult
        Results of `cgroup.comparison.compare`.
    T_target_source : (4,4) array_like of float
        True pose.
    correct : (n,) array_like of bool, optional
        Which matches are correct; `find_correct` finds them by default.

    Returns
    -------
    str
        HTML, for `write_page`.

    Examples
    --------
    >>> from cgroup.comparison import compare
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.pages import comparison_page
    >>> from cgroup.registration import correspond
    >>> pair = standin_pair(pixels=40)
    >>> matches = correspond(pair.source, pair.target)
    >>> results = compare(matches, pair.T_target_source, methods=["gc", "lc"])
    >>> clouds, truth = (pair.source, pair.target), pair.T_target_source
    >>> page = comparison_page(*clouds, matches, results, truth)
    >>> "LC" in page
    True
    """
    as_instance("correspondences", correspondences, Correspondences)
    given = as_items("results", results, "give several")
    found = [as_instance("results", each, MethodResult) for each in given]
    if not found:
        raise InputError("results", "none", "give at least one MethodResult")
    pose = check_rigid(T_target_source, "T_target_source")
    if correct is None:
        correct = find_correct(correspondences, pose, tolerance=tolerance)
    flags = as_flags("correct", correct, len(correspondences))
    count = int(np.count_nonzero(flags))
    view = View(
        title=as_instance("title", title, str),
        lead=(
            f'<p class="lead quiet">{len(flags):,} matches, {count:,} correct. '
            "P precision, R recall, F their harmonic mean; pose: whether the group's pose is right.</p>"
        ),
        source=as_points("source", source),
        target=as_points("target", target),
        colors=(_colors_of(source), _colors_of(target)),
        matches=correspondences,
        pose=pose,
        correct=flags,
        truth=pose,
        selections=[_selection(each) for each in found],
        first=int(np.argmax([each.score.f_score for each in found])),
        columns=("P", "R", "F", "pose"),
    )
    return view_page(view)


def _selection(result: MethodResult) -> Selection:
    score, info = result.score, look_up_method(result.method)
    label = result.method if info is None else info.label
    numbers = tuple(f"{value:.2f}" for value in (score.precision, score.recall, score.f_score))
    return Selection(label, result.grouping, (*numbers, "yes" if result.registered else "no"))
