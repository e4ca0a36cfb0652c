"""Shaded clouds: two side by side with lines between matched points, and one with keypoints."""

# Parts of matplotlib's methods are untyped.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from cgroup._checks.arrays import as_rows
from cgroup._checks.values import as_named
from cgroup._show.drawing import Drawing, as_points
from cgroup.evaluation import score_group
from cgroup.plots import shading, style
from cgroup.rigid import apply
from cgroup.types import AnyCloud, BoolArray, Correspondences, FloatArray, IndexArray

_COLUMNS = 3
_WIDTH = 9  # inches
_COLUMN = 4  # inches, of a comparison
_PANEL = 5  # inches, of keypoints
_JUDGED = {"correct": style.CORRECT, "wrong": style.WRONG}

MAX_LINES = 150  # largest number of lines; of more, an evenly spaced part is drawn, and the figure states it
_FEW = 1500  # fewer points are drawn as dots, because shaded cells would be coarse
_MOST = 100_000  # points of a cloud whose distances are computed

_DISTANCES = LinearSegmentedColormap.from_list("distances", style.DISTANCE_COLORS).with_extremes(
    bad=style.ALONE
)

_GAP = 0.35  # between the two clouds, in widths of the wider one
_TINTS = (style.SOURCE_TINT, style.TARGET_TINT)


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
        Left: the source, rotated by the pose, so that lines of correct matches are parallel. Right: both
        clouds, coloured by distance to the other one (from the plane about a point to the nearest point
        there). The colours end at the resolution of the matches; points without a neighbour within 2.5 times
        that are grey.

    Raises
    ------
    IndexError
        For a mask that isn't aligned with the matches.
    """
    pair = PairDrawing(source, target, T_target_source)
    figure = _figure(1.2 + float(np.clip(_WIDTH * pair.height / sum(pair.widths), 2.5, 7)), title)
    left, right = figure.subplots(1, 2, width_ratios=pair.widths)
    pair.draw_clouds(left)
    caption(left, "Grouped matches", pair.draw_selection(left, correspondences, mask, None))
    colors = pair.draw_agreement(right, correspondences)
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
    """Draw the group of each method; the rest is as for `registration_figure`.

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
        Correct and wrong matches in two colours, the source rotated by the true pose.

    Raises
    ------
    ValueError
        For no masks, or masks that aren't aligned with the matches.
    """
    as_named("masks", masks, "give a dict of masks by the name of the method")
    rows = -(-len(masks) // _COLUMNS)
    pair = PairDrawing(source, target, T_target_source)
    height = float(np.clip(0.97 * _COLUMN * pair.height / pair.widths[0], 1.2, 6)) + 0.3
    figure = _figure(rows * height + 0.75, title, width=_COLUMNS * _COLUMN)
    panels = _panels(figure, rows, _COLUMNS)
    for axes, (method, mask) in zip(panels, masks.items(), strict=False):
        pair.draw_clouds(axes)
        drawn = pair.draw_selection(axes, correspondences, mask, correct)
        score = score_group(mask, correct)
        numbers = f"P {score.precision:.2f}   R {score.recall:.2f}   F {score.f_score:.2f}"
        caption(axes, style.as_it_is(style.method_style(method).label), f"{numbers}   {drawn}")
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
    pair = PairDrawing(source, target, T_target_source)
    figure = _figure(float(np.clip(_WIDTH * pair.height / pair.widths[0], 2.5, 9)) + 0.7)
    axes = figure.subplots()
    pair.draw_clouds(axes)
    caption(axes, title, pair.draw_selection(axes, correspondences, mask, correct))
    _legend(figure, {"selected": style.GROUPED} if correct is None else _JUDGED)
    return figure


def figure_of(drawing: Drawing) -> Figure:
    """Draw a result, for its method `plot`."""
    given: dict[str, Any] = {"mask": drawing.mask, "T_target_source": drawing.pose, "title": drawing.title}
    clouds = drawing.source, drawing.target
    if drawing.is_placed and drawing.correct is None:
        return registration_figure(*clouds, drawing.matches, **given)
    return matches_figure(*clouds, drawing.matches, correct=drawing.correct, **given)


def keypoints_figure(points: AnyCloud, keypoints: Mapping[str, ArrayLike], *, title: str) -> Figure:
    """Draw keypoints on a cloud; the title is as for `registration_figure`.

    Parameters
    ----------
    points : (N,3) array_like of float
        Whole cloud.
    keypoints : mapping of str to (m,) array_like of int
        Rows of the cloud, by the name of the detector.

    Returns
    -------
    Figure
        One panel per detector, seen from the origin's side; keypoints on the far side are only counted.

    Raises
    ------
    IndexError
        For keypoints that are no rows of the points.
    """
    cloud = as_points("points", points)
    as_named("keypoints", keypoints, "give a dict of rows by the name of the detector")
    projected = shading.face_broadside(cloud).project(cloud)
    picture, visible = shading.shade(projected, style.TARGET_TINT), shading.find_front(projected)
    left, right, bottom, top = picture.extent
    columns = min(2, len(keypoints))
    rows = -(-len(keypoints) // columns)
    height = float(np.clip(_PANEL * (top - bottom) / (right - left), 2, 9)) + 0.4
    figure = _figure(rows * height + 0.5, title, width=columns * _PANEL)
    panels = _panels(figure, rows, columns)
    for axes, (name, found) in zip(panels, keypoints.items(), strict=False):
        show(axes, picture)
        rows_shown = as_rows(name, found)
        seen = projected[rows_shown[visible[rows_shown]]]
        axes.scatter(seen[:, 0], seen[:, 1], s=9, color=style.WRONG, edgecolors="white", linewidths=0.3)
        caption(axes, style.as_it_is(name), f"{len(rows_shown)} keypoints, {len(seen)} on this side")
    return figure


def _figure(height: float, title: str | None = None, *, width: float = _WIDTH) -> Figure:
    figure = Figure(figsize=(width, height), dpi=style.DOTS_PER_INCH, layout="constrained")
    if title is not None:
        figure.suptitle(style.as_it_is(title), color=style.TEXT)
    return figure


def _panels(figure: Figure, rows: int, columns: int) -> list[Axes]:
    """Return panels without axes, with equal scales in both directions."""
    panels = list(figure.subplots(rows, columns, squeeze=False).reshape(-1))
    for axes in panels:
        axes.set_axis_off()
        axes.set_aspect("equal", anchor="N")
    return panels


def _legend(figure: Figure, colors: Mapping[str, Any], **line: Any) -> None:  # noqa: ANN401 - of a `Line2D`
    handles = [Line2D([], [], color=color, label=name, **line) for name, color in colors.items()]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)


class PairDrawing:
    """Source and target in one plane, the source on the left; shared by all panels of a figure."""

    def __init__(self, source: AnyCloud, target: AnyCloud, pose: FloatArray) -> None:
        where = as_points("target", target)
        view = shading.face_broadside(where)
        self._axes, self._pose = view.axes[:2], pose
        self._clouds = view.project(apply(pose, as_points("source", source))), view.project(where)
        self._pictures = shading.shade(self._clouds[0], _TINTS[0]), shading.shade(self._clouds[1], _TINTS[1])
        (left, right, low, high), (start, end, bottom, top) = (each.extent for each in self._pictures)
        aside = right - start + _GAP * max(right - left, end - start)
        self._shift = np.array([aside, 0.0])  # of the target
        self._extents = self._pictures[0].extent, (start + aside, end + aside, bottom, top)
        # Of the clouds side by side, and on each other.
        self.widths = end + aside - left, max(right, end) - min(left, start)
        self.height = max(high, top) - min(low, bottom)

    def draw_clouds(self, axes: Axes) -> None:
        """Draw the two clouds side by side."""
        if max(map(len, self._clouds)) < _FEW:
            for cloud, tint, shift in zip(self._clouds, _TINTS, (0.0, self._shift), strict=True):
                x, y = (cloud[:, :2] + shift).T
                axes.scatter(x, y, s=12, color=tuple(0.85 * part for part in tint), linewidths=0)
        else:
            for picture, extent in zip(self._pictures, self._extents, strict=True):
                show(axes, picture, extent)
        _fit(axes, *self._extents)

    def draw_agreement(self, axes: Axes, matches: Correspondences) -> ScalarMappable:
        """Draw both clouds under the pose, coloured by distance; return the colours."""
        end = shading.color_range(matches, self._clouds[1])
        colors = ScalarMappable(Normalize(0.0, end), _DISTANCES)
        clouds = [cloud[shading.choose_rows(cloud, _MOST)] for cloud in self._clouds]
        values = [
            shading.distances(cloud, shading.planes(cloud), other, end)
            for cloud, other in zip(clouds, self._clouds[::-1], strict=True)
        ]
        picture = shading.paint(
            np.concatenate(clouds), np.concatenate(values), lambda mean: colors.to_rgba(mean)[..., :3]
        )
        show(axes, picture)
        _fit(axes, picture.extent)
        return colors

    def draw_selection(
        self, axes: Axes, matches: Correspondences, mask: BoolArray, correct: BoolArray | None
    ) -> str:
        """Draw the same fraction of correct and wrong matches of a group; return their number as text."""
        kinds = [(mask, style.GROUPED)]
        if correct is not None:
            kinds = [(mask & ~correct, style.WRONG), (mask & correct, style.CORRECT)]
        total, drawn = int(mask.sum()), 0
        share = min(1.0, MAX_LINES / max(total, 1))
        for chosen, color in kinds:
            rows = np.flatnonzero(chosen)
            drawn += self._draw_lines(axes, matches, spread(rows, round(share * len(rows))), color)
        return f"{total} selected" if drawn == total else f"{drawn} of {total} shown"

    def _draw_lines(self, axes: Axes, matches: Correspondences, rows: IndexArray, color: str) -> int:
        start = apply(self._pose, matches.source[rows]) @ self._axes.T
        end = matches.target[rows] @ self._axes.T + self._shift
        lines = np.stack([start, end], axis=1)
        axes.add_collection(LineCollection(list(lines), colors=color, linewidths=0.6, alpha=0.75))
        ends = lines.reshape(-1, 2)
        axes.scatter(ends[:, 0], ends[:, 1], s=2.5, color=color, linewidths=0, zorder=3)
        return len(rows)


def spread(rows: IndexArray, most: int) -> IndexArray:
    """Return at most `most` of the rows, evenly spaced."""
    if len(rows) <= most:
        return rows
    return rows[np.linspace(0, len(rows) - 1, most).astype(np.int64)]


def show(axes: Axes, picture: shading.Picture, extent: shading.Extent | None = None) -> None:
    """Draw a picture, at its own or a given extent."""
    axes.imshow(picture.rgba, extent=extent or picture.extent, origin="lower", interpolation="nearest")


def caption(axes: Axes, name: str, numbers: str = "") -> None:
    """Write a name above a panel on the left, and numbers on the right."""
    axes.set_title(name, loc="left", fontsize=11, fontweight="bold", color=style.TEXT)
    axes.set_title(numbers, loc="right", fontsize=9, color=style.QUIET_TEXT)


def _fit(axes: Axes, *extents: shading.Extent) -> None:
    left, right, bottom, top = zip(*extents, strict=True)
    margin = 0.02 * (max(right) - min(left))
    axes.set_xlim(min(left) - margin, max(right) + margin)
    axes.set_ylim(min(bottom) - margin, max(top) + margin)
    axes.set_aspect("equal", anchor="N")
    axes.set_axis_off()
