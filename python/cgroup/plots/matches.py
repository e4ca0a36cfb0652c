"""Shaded clouds: two side by side with lines between matched points, and one with keypoints on it."""

# Parts of matplotlib's methods are untyped.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_points, as_rows
from cgroup._checks.values import as_named
from cgroup._show.drawing import Drawing
from cgroup.evaluation import score_group
from cgroup.plots import style
from cgroup.plots.scene import Scene, caption, show
from cgroup.plots.shading import face_broadside, find_front, shade
from cgroup.types import AnyCloud, BoolArray, Correspondences, FloatArray

_COLUMNS = 3
_WIDTH = 9  # inches
_COLUMN = 4  # inches, of a comparison
_PANEL = 5  # inches, of keypoints
_JUDGED = {"correct": style.CORRECT, "wrong": style.WRONG}


def registration_figure(
    source: AnyCloud,
    target: AnyCloud,
    correspondences: Correspondences,
    *,
    mask: BoolArray,
    T_target_source: FloatArray,
    title: str,
) -> Figure:
    """Draw the matches of a group, and the distance between the clouds under the pose.

    Parameters
    ----------
    source, target : (N,3) array_like of float
        Whole clouds.
    correspondences : Correspondences
        All matches.
    mask : (n,) array of bool
        The group.
    T_target_source : (4,4) array of float64
        Estimated pose.
    title : str
        Shown on top.

    Returns
    -------
    Figure
        Left: the source, rotated by the pose, so that lines of right matches are parallel. Right: both
        clouds, coloured by distance to the other one (from the plane about a point to the nearest point
        there). The colours end at the resolution of the matches; points without a neighbour within 2.5 times
        that are grey.

    Raises
    ------
    IndexError
        For a mask that isn't aligned with the matches.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.plots import registration_figure
    >>> from cgroup.registration import register
    >>> pair = standin_pair(pixels=60)
    >>> done = register(pair.source, pair.target)
    >>> figure = registration_figure(
    ...     pair.source.points,
    ...     pair.target.points,
    ...     done.correspondences,
    ...     mask=done.grouping.mask,
    ...     T_target_source=done.T_target_source,
    ...     title="Two views of a stone",
    ... )
    >>> figure.savefig("registration.png")
    """
    scene = Scene(source, target, T_target_source)
    figure = _figure(1.2 + float(np.clip(_WIDTH * scene.height / sum(scene.widths), 2.5, 7)), title)
    left, right = figure.subplots(1, 2, width_ratios=scene.widths)
    scene.draw_clouds(left)
    caption(left, "Grouped matches", scene.draw_selection(left, correspondences, mask, None))
    colors = scene.draw_agreement(right, correspondences)
    caption(right, "Agreement")
    bar = figure.colorbar(colors, ax=right, location="bottom", extend="max", shrink=0.9, aspect=25, pad=0.02)
    bar.set_label("distance to the other cloud,\nin the clouds' unit")
    end = colors.get_clim()[1]
    bar.set_ticks([0.0, end / 2, end], labels=["0", f"{end / 2:.2g}", f"{end:.2g}"])
    tints = {"source": style.SOURCE_TINT, "target": style.TARGET_TINT, "no counterpart": style.ALONE}
    _legend(figure, tints, marker="o", linestyle="")
    return figure


def comparison_figure(
    source: AnyCloud,
    target: AnyCloud,
    correspondences: Correspondences,
    *,
    correct: BoolArray,
    masks: Mapping[str, BoolArray],
    T_target_source: FloatArray,
    title: str,
) -> Figure:
    """Draw the group of each method, correct and wrong matches in two colours.

    Further parameters as for `registration_figure`.

    Parameters
    ----------
    correct : (n,) array of bool
        Which matches are correct.
    masks : mapping of str to (n,) array of bool
        Groups by the name of the method; one panel each.
    T_target_source : (4,4) array of float64
        True pose.

    Returns
    -------
    Figure
        The source is rotated by the true pose, so that lines of correct matches are parallel.

    Raises
    ------
    ValueError
        For masks that aren't aligned with the matches.
    """
    as_named("masks", masks, "give a dict of masks by the name of the method")
    rows = -(-len(masks) // _COLUMNS)
    scene = Scene(source, target, T_target_source)
    height = float(np.clip(0.97 * _COLUMN * scene.height / scene.widths[0], 1.2, 6)) + 0.3
    figure = _figure(rows * height + 0.75, title, width=_COLUMNS * _COLUMN)
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).reshape(-1)
    for axes, (method, mask) in zip(panels, masks.items(), strict=False):
        scene.draw_clouds(axes)
        drawn = scene.draw_selection(axes, correspondences, mask, correct)
        score = score_group(mask, correct)
        numbers = f"P {score.precision:.2f}   R {score.recall:.2f}   F {score.f_score:.2f}"
        caption(axes, style.as_it_is(style.method_style(method).label), f"{numbers}   {drawn}")
    for axes in panels[len(masks) :]:
        axes.set_axis_off()
    _legend(figure, _JUDGED)
    return figure


def matches_figure(
    source: FloatArray,
    target: FloatArray,
    correspondences: Correspondences,
    *,
    mask: BoolArray,
    T_target_source: FloatArray,
    correct: BoolArray | None = None,
    title: str,
) -> Figure:
    """Draw two clouds side by side, the source rotated by the pose, and the selected matches."""
    scene = Scene(source, target, T_target_source)
    figure = _figure(float(np.clip(_WIDTH * scene.height / scene.widths[0], 2.5, 9)) + 0.7)
    axes = figure.subplots()
    scene.draw_clouds(axes)
    caption(axes, title, scene.draw_selection(axes, correspondences, mask, correct))
    _legend(figure, {"selected": style.GROUPED} if correct is None else _JUDGED)
    return figure


def figure_of(drawing: Drawing) -> Figure:
    """Draw a result, for its method `plot`."""
    given: dict[str, Any] = {"mask": drawing.mask, "T_target_source": drawing.pose, "title": drawing.title}
    clouds = drawing.source, drawing.target
    if drawing.is_placed and drawing.correct is None:
        return registration_figure(*clouds, drawing.matches, **given)
    return matches_figure(*clouds, drawing.matches, correct=drawing.correct, **given)


def keypoints_figure(
    points: AnyCloud,
    keypoints: Mapping[str, ArrayLike],
    *,
    title: str,
    viewpoint: ArrayLike = (0, 0, 0),
) -> Figure:
    """Draw keypoints on a cloud, one panel per detector.

    Parameters
    ----------
    points : (N,3) array_like of float
        Whole cloud.
    keypoints : mapping of str to (m,) array_like of int
        Rows of the cloud, by the name of the detector.
    title : str
        Shown on top.
    viewpoint : (3,) array_like of float
        Scanner position; the cloud is drawn from that side.

    Returns
    -------
    Figure
        Keypoints on the far side are left out and counted below the panel.

    Raises
    ------
    IndexError
        For keypoints that are no rows of the points.
    """
    cloud = as_points("points", points)
    as_named("keypoints", keypoints, "give a dict of rows by the name of the detector")
    projected = face_broadside(cloud, viewpoint).project(cloud)
    picture, visible = shade(projected, style.TARGET_TINT), find_front(projected)
    left, right, bottom, top = picture.extent
    columns = min(2, len(keypoints))
    rows = -(-len(keypoints) // columns)
    height = float(np.clip(_PANEL * (top - bottom) / (right - left), 2, 9)) + 0.4
    figure = _figure(rows * height + 0.5, title, width=columns * _PANEL)
    panels = figure.subplots(rows, columns, squeeze=False).reshape(-1)
    for axes in panels:
        axes.set_axis_off()
        axes.set_aspect("equal", anchor="N")
    for axes, (name, found) in zip(panels, keypoints.items(), strict=False):
        show(axes, picture)
        rows_shown = as_rows(name, found)
        seen = projected[rows_shown[visible[rows_shown]]]
        axes.scatter(seen[:, 0], seen[:, 1], s=9, color=style.WRONG, edgecolors="white", linewidths=0.3)
        caption(axes, name, f"{len(rows_shown)} keypoints, {len(seen)} on this side")
    return figure


def _figure(height: float, title: str | None = None, *, width: float = _WIDTH) -> Figure:
    figure = Figure(figsize=(width, height), dpi=style.DOTS_PER_INCH, layout="constrained")
    if title is not None:
        figure.suptitle(title, color=style.TEXT)
    return figure


def _legend(figure: Figure, colors: Mapping[str, Any], **line: Any) -> None:  # noqa: ANN401 - of a `Line2D`
    handles = [Line2D([], [], color=color, label=name, **line) for name, color in colors.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
