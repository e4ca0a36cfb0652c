"""Two clouds in one plane and lines between them, the basis of match figures."""

# Parts of matplotlib's methods are untyped.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize

from cgroup._checks.arrays import as_points
from cgroup.plots import style
from cgroup.plots.agreement import color_range, distances, planes, thin
from cgroup.plots.shading import Picture, face_broadside, paint, shade
from cgroup.rigid import apply
from cgroup.types import AnyCloud, BoolArray, Correspondences, FloatArray, IndexArray

Extent: TypeAlias = tuple[float, float, float, float]


MAX_LINES = 150
"""Largest number of lines; of more, an evenly spaced part is drawn, and the figure states it."""

_FEW = 1500
"""Fewer points are drawn as dots, because shaded cells would be coarse."""

_MOST = 100_000
"""Largest number of points of a cloud whose distances are computed."""

_DISTANCES = LinearSegmentedColormap.from_list("distances", style.DISTANCE_COLORS).with_extremes(
    bad=style.ALONE
)

_GAP = 0.35  # between the two clouds, in widths of the wider one
_TINTS = (style.SOURCE_TINT, style.TARGET_TINT)


class Scene:
    """Source and target in one plane, the source on the left; shared by all panels of a figure."""

    def __init__(self, source: AnyCloud, target: AnyCloud, pose: FloatArray) -> None:
        where = as_points("target", target)
        view = face_broadside(where)
        self._axes, self._pose = view.axes[:2], pose
        self._clouds = view.project(apply(pose, as_points("source", source))), view.project(where)
        self._pictures = shade(self._clouds[0], _TINTS[0]), shade(self._clouds[1], _TINTS[1])
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
        end = color_range(matches, self._clouds[1])
        colors = ScalarMappable(Normalize(0.0, end), _DISTANCES)
        clouds = [cloud[thin(cloud, _MOST)] for cloud in self._clouds]
        values = [
            distances(cloud, planes(cloud), other, end)
            for cloud, other in zip(clouds, self._clouds[::-1], strict=True)
        ]
        picture = paint(
            np.concatenate(clouds), np.concatenate(values), lambda mean: colors.to_rgba(mean)[..., :3]
        )
        show(axes, picture)
        _fit(axes, picture.extent)
        return colors

    def draw_selection(
        self, axes: Axes, matches: Correspondences, mask: BoolArray, correct: BoolArray | None
    ) -> str:
        """Draw the same share of correct and wrong matches of a group; return their number as text."""
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


def show(axes: Axes, picture: Picture, extent: Extent | None = None) -> None:
    """Draw a picture, at its own or another extent."""
    axes.imshow(picture.rgba, extent=extent or picture.extent, origin="lower", interpolation="nearest")


def caption(axes: Axes, name: str, numbers: str = "") -> None:
    """Write a name above a panel on the left, and numbers on the right."""
    axes.set_title(name, loc="left", fontsize=11, fontweight="bold", color=style.TEXT)
    axes.set_title(numbers, loc="right", fontsize=9, color=style.QUIET_TEXT)


def _fit(axes: Axes, *extents: Extent) -> None:
    left, right, bottom, top = zip(*extents, strict=True)
    margin = 0.02 * (max(right) - min(left))
    axes.set_xlim(min(left) - margin, max(right) + margin)
    axes.set_ylim(min(bottom) - margin, max(top) + margin)
    axes.set_aspect("equal", anchor="N")
    axes.set_axis_off()
