"""Matches between two clouds in the viewer Rerun (https://rerun.io), by the extra ``cgroup[rerun]``."""

from __future__ import annotations

import importlib
import os
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.values import as_instance, as_path
from cgroup._explain import explain_matches
from cgroup._show.drawing import as_flags, as_points
from cgroup.errors import InputError, NoConsensusError
from cgroup.io.files import check_outputs
from cgroup.pages.figure import Kind, kinds_of
from cgroup.plots import style
from cgroup.rigid import apply, check_rigid
from cgroup.types import AnyCloud, Correspondences, FloatArray, Grouping

_STEPS = 21
"""From the given source to the posed one."""


def log_to_rerun(
    source: AnyCloud,
    target: AnyCloud,
    correspondences: Correspondences,
    grouping: Grouping,
    *,
    T_target_source: ArrayLike | None = None,
    correct: ArrayLike | None = None,
    path: str | os.PathLike[str] | None = None,
) -> None:
    """Log clouds, matches kept and dropped, and the pose, for the viewer Rerun.

    On the timeline ``source`` the source moves from its given position (0) to its pose (20).

    Parameters
    ----------
    source, target : PointCloud or (N,3) array_like of float
        Whole clouds.
    correspondences : Correspondences
        All matches.
    grouping : Grouping
        Group of a method; the label of each match gives the reason.
    T_target_source : (4,4) array_like of float, optional
        The pose; that of the group by default.
    correct : (n,) array_like of bool, optional
        Which matches are correct; lines are coloured by it.
    path : path-like, optional
        A file, usually ``.rrd``, for ``rerun``; by default, the recording that ``rerun.init`` started.

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
    for name, points, tint in zip(
        ("source", "target"), clouds, (style.SOURCE_TINT, style.TARGET_TINT), strict=True
    ):
        color = [round(255 * part) for part in tint]
        recording.log(f"{name}/points", rerun.Points3D(points, colors=[color]), static=True)
    target_points = correspondences.target.astype(np.float64)
    for step in range(_STEPS):
        recording.set_time("source", sequence=step)
        moved = between(np.eye(4), pose, step / (_STEPS - 1), clouds[0].mean(axis=0))
        recording.log("source", rerun.Transform3D(translation=moved[:3, 3], mat3x3=moved[:3, :3]))
        ends = np.stack([apply(moved, correspondences.source), target_points], axis=1)
        for kind in kinds_of(grouping.mask, flags):
            looks = _looks(grouping, kind) if step == 0 else {}  # they stay as they are
            lines = rerun.LineStrips3D(ends[kind.rows], **looks)
            recording.log(f"matches/{kind.text.replace(', ', '/')}", lines)
    recording.flush()


def between(start: FloatArray, end: FloatArray, share: float, center: FloatArray) -> FloatArray:
    """Return a rigid transform between two: the centre moves along a line, the rest rotates about it."""
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
    """Return a recording into a file, or the open one."""
    if path is None:
        recording = rerun.get_global_data_recording()
        if recording is None:
            remedy = "there is no recording; give a path, or call rerun.init(..., spawn=True) before"
            raise InputError("path", remedy=remedy)
        return recording
    path = as_path("path", path)
    check_outputs([path])
    recording = rerun.RecordingStream("cgroup")
    try:
        recording.save(path)
    except (OSError, RuntimeError) as error:
        message = f"{path}: can't be written ({error})"
        raise InputError(message) from error
    return recording


def _looks(grouping: Grouping, kind: Kind) -> dict[str, Any]:
    color = [int(kind.color[k : k + 2], 16) for k in (1, 3, 5)]
    explained = explain_matches(grouping, np.flatnonzero(kind.rows).tolist())
    labels = [f"{each.index}: {each.reason}" for each in explained]
    return {"colors": [color], "labels": labels, "show_labels": False}
