"""Matches between two clouds in the viewer Rerun (https://rerun.io), by the extra ``cgroup[rerun]``."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

import numpy as np

from cgroup._checks.values import as_instance, as_path
from cgroup._explain import explain_matches
from cgroup._show.drawing import as_flags, as_points
from cgroup.errors import InputError, NoConsensusError
from cgroup.plots import style
from cgroup.rigid import apply, check_rigid
from cgroup.types import Correspondences, Grouping

if TYPE_CHECKING:
    import os

    from numpy.typing import ArrayLike

    from cgroup.types import BoolArray, FloatArray, PointCloud, RealArray

_TIMELINE = "source"
_STEPS = 21
"""From where the source is given to where the pose lays it."""


def log_to_rerun(
    source: PointCloud | ArrayLike,
    target: PointCloud | ArrayLike,
    correspondences: Correspondences,
    grouping: Grouping,
    *,
    T_target_source: ArrayLike | None = None,
    correct: ArrayLike | None = None,
    path: str | os.PathLike[str] | None = None,
) -> None:
    """Log clouds, matches kept and dropped, and the pose, for the viewer Rerun.

    On the timeline ``source`` the source moves from where it is given (0) to where the pose lays it (20).

    Parameters
    ----------
    source, target : PointCloud or (N,3) array_like of float
        Whole clouds.
    correspondences : Correspondences
        All matches.
    grouping : Grouping
        What was selected of them; the label of each match says why.
    T_target_source : (4,4) array_like of float, optional
        The pose; that of the group where it is not given.
    correct : (n,) array_like of bool, optional
        Which matches are correct; lines are coloured by it.
    path : path-like, optional
        A file, usually ``.rrd``, to be opened by ``rerun``. Without it, the recording that ``rerun.init``
        started takes it.

    Raises
    ------
    InputError
        If rerun-sdk isn't installed, an argument doesn't fit, there is no pose, or no path and no recording.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from cgroup import group
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.pages import log_to_rerun
    >>> from cgroup.registration import correspond
    >>> pair = standin_pair(pixels=40)
    >>> matches = correspond(pair.source, pair.target)
    >>> found = group(matches, "gc")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "matches.rrd")
    ...     log_to_rerun(pair.source, pair.target, matches, found, path=path)
    """
    as_instance("correspondences", correspondences, Correspondences)
    as_instance("grouping", grouping, Grouping)
    clouds = as_points("source", source), as_points("target", target)
    pose = _pose(grouping) if T_target_source is None else check_rigid(T_target_source, "T_target_source")
    flags = None if correct is None else as_flags("correct", correct, len(correspondences))
    rerun = _load_rerun()
    recording = _open(rerun, path)
    _log_clouds(rerun, recording, clouds)
    kinds = _kinds(grouping.mask, flags)
    target_points = correspondences.target.astype(np.float64)
    for step in range(_STEPS):
        recording.set_time(_TIMELINE, sequence=step)
        moved = between(np.eye(4), pose, step / (_STEPS - 1), clouds[0].mean(axis=0))
        recording.log("source", rerun.Transform3D(translation=moved[:3, 3], mat3x3=moved[:3, :3]))
        ends = np.stack([apply(moved, correspondences.source), target_points], axis=1)
        _log_lines(rerun, recording, ends, kinds, grouping if step == 0 else None)
    recording.flush()


def between(start: FloatArray, end: FloatArray, share: float, center: FloatArray) -> FloatArray:
    """Return a rigid transform between two: the centre moves straight on, what is about it turns.

    Parameters
    ----------
    start, end : (4,4) array of float64
        Rigid transforms.
    share : float
        0 for the start, 1 for the end.
    center : (3,) array of float64
        The point that moves straight on.
    """
    turn = start[:3, :3].T @ end[:3, :3]
    axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    angle = float(np.arctan2(np.linalg.norm(axis), np.trace(turn) - 1.0))
    if np.linalg.norm(axis) < 1e-9:  # none, or half a turn, whose axis is the eigenvector of 1
        axis = np.linalg.svd(turn - np.eye(3))[2][-1]
    axis /= np.linalg.norm(axis)
    cross = np.cross(np.eye(3), axis)  # times a vector: the axis cross it
    part = share * angle
    rotation = start[:3, :3] @ (np.eye(3) + np.sin(part) * cross + (1.0 - np.cos(part)) * cross @ cross)
    places = [matrix[:3, :3] @ center + matrix[:3, 3] for matrix in (start, end)]
    moved = np.eye(4)
    moved[:3, :3] = rotation
    moved[:3, 3] = (1.0 - share) * places[0] + share * places[1] - rotation @ center
    return moved


def _pose(grouping: Grouping) -> FloatArray:
    try:
        return grouping.transform()
    except NoConsensusError as error:
        raise InputError("T_target_source", remedy="the group fixes no pose; give one") from error


def _load_rerun() -> Any:  # noqa: ANN401 - a module
    try:
        return importlib.import_module("rerun")
    except ModuleNotFoundError as error:
        message = "a Rerun recording needs rerun-sdk; pip install 'cgroup[rerun]'"
        raise InputError(message) from error


def _open(rerun: Any, path: str | os.PathLike[str] | None) -> Any:  # noqa: ANN401 - rerun's
    """Return a recording that goes to a file, or the one that is open."""
    if path is None:
        recording = rerun.get_global_data_recording()
        if recording is None:
            raise InputError(
                "path",
                remedy="there is no recording; give a path, or call rerun.init(..., spawn=True) before",
            )
        return recording
    recording = rerun.RecordingStream("cgroup")
    try:
        recording.save(as_path("path", path))
    except (OSError, RuntimeError) as error:
        message = f"{path}: can't be written ({error})"
        raise InputError(message) from error
    return recording


def _log_clouds(rerun: Any, recording: Any, clouds: tuple[FloatArray, FloatArray]) -> None:  # noqa: ANN401
    tints = (style.SOURCE_TINT, style.TARGET_TINT)
    for name, points, tint in zip(("source", "target"), clouds, tints, strict=True):
        color = [round(255 * part) for part in tint]
        recording.log(f"{name}/points", rerun.Points3D(points, colors=[color]), static=True)


def _log_lines(
    rerun: Any,  # noqa: ANN401 - a module
    recording: Any,  # noqa: ANN401 - rerun's
    ends: RealArray,
    kinds: list[tuple[str, BoolArray, str]],
    labeled: Grouping | None,
) -> None:
    """Log where the lines are; colours and labels, which stay, with the first step only."""
    for name, rows, color in kinds:
        looks: dict[str, Any] = {}
        if labeled is not None:
            shown = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
            looks = {"colors": [shown], "labels": _labels(labeled, rows), "show_labels": False}
        recording.log(f"matches/{name}", rerun.LineStrips3D(ends[rows], **looks))


def _kinds(mask: BoolArray, correct: BoolArray | None) -> list[tuple[str, BoolArray, str]]:
    if correct is None:
        return [("kept", mask, style.GROUPED), ("dropped", ~mask, style.QUIET_TEXT)]
    return [
        ("kept/correct", mask & correct, style.CORRECT),
        ("kept/wrong", mask & ~correct, style.WRONG),
        ("dropped/correct", ~mask & correct, style.MISSED),
        ("dropped/wrong", ~mask & ~correct, style.QUIET_TEXT),
    ]


def _labels(grouping: Grouping, rows: BoolArray) -> list[str]:
    said = explain_matches(grouping, np.flatnonzero(rows).tolist())
    return [f"{each.index}: {each.reason}" for each in said]
