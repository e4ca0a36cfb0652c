"""Two clouds side by side, and lines between matched points."""

# Parts of matplotlib's methods are untyped.
# pyright: reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from cgroup._arguments import as_points
from cgroup.evaluation import score_group
from cgroup.plots import style
from cgroup.plots.shading import Picture, face_broadside, overlay, shade
from cgroup.rigid import apply

if TYPE_CHECKING:
    from collections.abc import Mapping

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike

    from cgroup.types import BoolArray, Correspondences, FloatArray, IndexArray

MAX_LINES = 150
"""More lines than this hide each other; an evenly spaced part of them is drawn, and the figure says so."""

_GAP = 0.35  # between the two clouds, in widths of the wider one
_COLUMNS = 3
_WIDTH = 12  # inches


def registration_figure(
    source: ArrayLike,
    target: ArrayLike,
    correspondences: Correspondences,
    *,
    mask: BoolArray,
    T_target_source: FloatArray,
    title: str,
) -> Figure:
    """Draw the grouped matches between two clouds, and the two clouds as the pose lays them.

    Parameters
    ----------
    source, target : (N,3) array_like of float
        Whole clouds.
    correspondences : Correspondences
        All matches.
    mask : (n,) array of bool
        The group.
    T_target_source : (4,4) array of float64
        The pose found.
    title : str
        Shown on top.

    Returns
    -------
    Figure
        The source is shown turned as in the pose, so that lines of right matches run parallel.
    """
    scene = _Scene.of(source, target, T_target_source)
    widths, height = scene.widths, scene.height
    size = (_WIDTH, float(np.clip(_WIDTH * height / sum(widths), 2.5, 9)) + 0.9)
    figure = Figure(figsize=size, dpi=style.DOTS_PER_INCH, layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=widths)
    scene.draw_clouds(left)
    drawn = scene.draw_lines(left, correspondences, np.flatnonzero(mask), style.GROUPED)
    _caption(left, "Grouped matches", _format_count(drawn, int(mask.sum())))
    scene.draw_overlay(right)
    _caption(right, "Source placed on target", "")
    figure.suptitle(title, color=style.TEXT)
    handles = [
        Line2D([], [], marker="o", linestyle="", color=tint, label=name)
        for name, tint in (("source", style.SOURCE_TINT), ("target", style.TARGET_TINT))
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def comparison_figure(
    source: ArrayLike,
    target: ArrayLike,
    correspondences: Correspondences,
    *,
    correct: BoolArray,
    masks: Mapping[str, BoolArray],
    T_target_source: FloatArray,
    title: str,
) -> Figure:
    """Draw what each method selected, correct matches in one colour and wrong ones in another.

    Parameters
    ----------
    source, target : (N,3) array_like of float
        Whole clouds.
    correspondences : Correspondences
        All matches.
    correct : (n,) array of bool
        Which of them are correct.
    masks : mapping of str to (n,) array of bool
        What each method selected, by the method's name; one panel each.
    T_target_source : (4,4) array of float64
        The true pose.
    title : str
        Shown on top.

    Returns
    -------
    Figure
        The source is shown turned as in the true pose, so that lines of correct matches run parallel.
    """
    rows = -(-len(masks) // _COLUMNS)
    scene = _Scene.of(source, target, T_target_source)
    height = float(np.clip(0.97 * _WIDTH / _COLUMNS * scene.height / scene.widths[0], 1.2, 6)) + 0.3
    figure = Figure(figsize=(_WIDTH, rows * height + 0.75), dpi=style.DOTS_PER_INCH, layout="constrained")
    panels = figure.subplots(rows, _COLUMNS, squeeze=False).reshape(-1)
    for axes, (method, mask) in zip(panels, masks.items(), strict=False):
        scene.draw_clouds(axes)
        drawn = scene.draw_selection(axes, correspondences, mask, correct)
        score = score_group(mask, correct)
        numbers = f"P {score.precision:.2f}   R {score.recall:.2f}   F {score.f_score:.2f}"
        label = style.as_it_is(style.method_style(method).label)
        _caption(axes, label, f"{numbers}   {_format_count(drawn, score.selected)}")
    for axes in panels[len(masks) :]:
        axes.set_axis_off()
    figure.suptitle(title, color=style.TEXT)
    handles = [
        Line2D([], [], color=color, label=name)
        for name, color in (("correct", style.CORRECT), ("wrong", style.WRONG))
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


@dataclass(frozen=True, eq=False)
class _Scene:
    """Source and target in one plane, the source on the left; shared by all panels of a figure."""

    to_plane: FloatArray  # (2,3)
    pose: FloatArray  # (4,4)
    shift: FloatArray  # (2,), of the target in the plane
    pictures: tuple[Picture, Picture]  # of source and target, both where the pose puts them
    overlay: Picture

    @classmethod
    def of(cls, source: ArrayLike, target: ArrayLike, pose: FloatArray) -> _Scene:
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
        )

    @property
    def target_extent(self) -> tuple[float, float, float, float]:
        left, right, bottom, top = self.pictures[1].extent
        return left + self.shift[0], right + self.shift[0], bottom, top

    @property
    def widths(self) -> tuple[float, float]:
        """Of the two clouds side by side, and of the two on each other."""
        left, right, *_ = self.overlay.extent
        return self.target_extent[1] - self.pictures[0].extent[0], right - left

    @property
    def height(self) -> float:
        bottom, top = self.overlay.extent[2:]
        return top - bottom

    def draw_clouds(self, axes: Axes) -> None:
        source, target = self.pictures
        _show(axes, source, source.extent)
        _show(axes, target, self.target_extent)
        _fit(axes, source.extent, self.target_extent)

    def draw_overlay(self, axes: Axes) -> None:
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
        if len(rows) > limit:
            rows = rows[np.linspace(0, len(rows) - 1, limit).astype(np.int64)]
        source = apply(self.pose, correspondences.source[rows])
        start = source @ self.to_plane.T
        end = correspondences.target[rows] @ self.to_plane.T + self.shift
        lines = np.stack([start, end], axis=1)
        axes.add_collection(LineCollection(list(lines), colors=color, linewidths=0.6, alpha=0.75))
        ends = lines.reshape(-1, 2)
        axes.scatter(ends[:, 0], ends[:, 1], s=2.5, color=color, linewidths=0, zorder=3)
        return len(rows)


def _show(axes: Axes, picture: Picture, extent: tuple[float, float, float, float]) -> None:
    axes.imshow(picture.rgba, extent=extent, origin="lower", interpolation="nearest")


def _fit(axes: Axes, *extents: tuple[float, float, float, float]) -> None:
    left, right, bottom, top = zip(*extents, strict=True)
    margin = 0.02 * (max(right) - min(left))
    axes.set_xlim(min(left) - margin, max(right) + margin)
    axes.set_ylim(min(bottom) - margin, max(top) + margin)
    axes.set_aspect("equal", anchor="N")
    axes.set_axis_off()


def _caption(axes: Axes, name: str, numbers: str) -> None:
    axes.set_title(name, loc="left", fontsize=11, fontweight="bold", color=style.TEXT)
    axes.set_title(numbers, loc="right", fontsize=9, color=style.QUIET_TEXT)


def _format_count(drawn: int, total: int) -> str:
    return f"{total} selected" if drawn == total else f"{drawn} of {total} shown"
