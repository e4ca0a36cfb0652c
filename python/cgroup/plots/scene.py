"""Two clouds in one plane and lines between them, the basis of match figures."""

# Parts of matplotlib's methods are untyped.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection

from cgroup._checks.arrays import as_points
from cgroup.plots import style
from cgroup.plots.shading import Picture, face_broadside, overlay, shade
from cgroup.rigid import apply

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from cgroup.types import BoolArray, Correspondences, FloatArray, IndexArray

MAX_LINES = 150
"""More lines than this hide each other; an evenly spaced part of them is drawn, and the figure says so."""

_FEW = 1500
"""Fewer points than this are drawn as dots: shaded, they would be coarse cells."""

_GAP = 0.35  # between the two clouds, in widths of the wider one


@dataclass(frozen=True, eq=False)
class Scene:
    """Source and target in one plane, the source on the left; shared by all panels of a figure."""

    to_plane: FloatArray  # (2,3)
    pose: FloatArray  # (4,4)
    shift: FloatArray  # (2,), of the target in the plane
    pictures: tuple[Picture, Picture]  # of source and target, both where the pose puts them
    overlay: Picture
    projected: tuple[FloatArray, FloatArray]  # both clouds, in the plane

    @classmethod
    def of(cls, source: ArrayLike, target: ArrayLike, pose: FloatArray) -> Scene:
        """Make the scene of two clouds and a pose between them."""
        where = as_points("target", target)
        view = face_broadside(where)
        placed = view.project(apply(pose, as_points("source", source)))
        there = view.project(where)
        tints = (style.SOURCE_TINT, style.TARGET_TINT)
        pictures = shade(placed, tints[0]), shade(there, tints[1])
        (left, right, *_), (start, end, *_) = (picture.extent for picture in pictures)
        gap = _GAP * max(right - left, end - start)
        return cls(
            view.axes[:2],
            pose,
            np.array([right - start + gap, 0.0]),
            pictures,
            overlay(placed, there, tints),
            (placed[:, :2], there[:, :2]),
        )

    @property
    def target_extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top of the target, where it stands beside the source."""
        left, right, bottom, top = self.pictures[1].extent
        return left + self.shift[0], right + self.shift[0], bottom, top

    @property
    def widths(self) -> tuple[float, float]:
        """Of the two clouds side by side, and of the two on each other."""
        left, right, *_ = self.overlay.extent
        return self.target_extent[1] - self.pictures[0].extent[0], right - left

    @property
    def height(self) -> float:
        """Of the two clouds on each other."""
        bottom, top = self.overlay.extent[2:]
        return top - bottom

    def draw_clouds(self, axes: Axes) -> None:
        """Draw the two clouds side by side."""
        source, target = self.pictures
        extents = source.extent, self.target_extent
        if max(map(len, self.projected)) < _FEW:
            self._draw_dots(axes)
        else:
            _show(axes, source, extents[0])
            _show(axes, target, extents[1])
        _fit(axes, *extents)

    def _draw_dots(self, axes: Axes) -> None:
        tints = (style.SOURCE_TINT, style.TARGET_TINT)
        shifts = (np.zeros(2), self.shift)
        for points, tint, shift in zip(self.projected, tints, shifts, strict=True):
            x, y = (points + shift).T
            axes.scatter(x, y, s=12, color=tuple(0.85 * part for part in tint), linewidths=0)

    def draw_overlay(self, axes: Axes) -> None:
        """Draw the two clouds on each other."""
        _show(axes, self.overlay, self.overlay.extent)
        _fit(axes, self.overlay.extent)

    def draw_selection(
        self, axes: Axes, correspondences: Correspondences, mask: BoolArray, correct: BoolArray
    ) -> int:
        """Draw the correct and the wrong ones of a group, of both the same share; returns how many."""
        share = min(1.0, MAX_LINES / max(int(mask.sum()), 1))
        drawn = 0
        for chosen, color in ((mask & ~correct, style.WRONG), (mask & correct, style.CORRECT)):
            rows = np.flatnonzero(chosen)
            drawn += self.draw_lines(axes, correspondences, rows, color, round(share * len(rows)))
        return drawn

    def draw_lines(
        self,
        axes: Axes,
        correspondences: Correspondences,
        rows: IndexArray,
        color: str,
        limit: int = MAX_LINES,
    ) -> int:
        """Draw at most `limit` of the rows; returns how many."""
        rows = spread(rows, limit)
        source = apply(self.pose, correspondences.source[rows])
        start = source @ self.to_plane.T
        end = correspondences.target[rows] @ self.to_plane.T + self.shift
        lines = np.stack([start, end], axis=1)
        axes.add_collection(LineCollection(list(lines), colors=color, linewidths=0.6, alpha=0.75))
        ends = lines.reshape(-1, 2)
        axes.scatter(ends[:, 0], ends[:, 1], s=2.5, color=color, linewidths=0, zorder=3)
        return len(rows)


def spread(rows: IndexArray, most: int) -> IndexArray:
    """Return at most so many of the rows, evenly spread."""
    if len(rows) <= most:
        return rows
    return rows[np.linspace(0, len(rows) - 1, most).astype(np.int64)]


def _show(axes: Axes, picture: Picture, extent: tuple[float, float, float, float]) -> None:
    axes.imshow(picture.rgba, extent=extent, origin="lower", interpolation="nearest")


def _fit(axes: Axes, *extents: tuple[float, float, float, float]) -> None:
    left, right, bottom, top = zip(*extents, strict=True)
    margin = 0.02 * (max(right) - min(left))
    axes.set_xlim(min(left) - margin, max(right) + margin)
    axes.set_ylim(min(bottom) - margin, max(top) + margin)
    axes.set_aspect("equal", anchor="N")
    axes.set_axis_off()
