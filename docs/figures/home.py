"""The picture of the home page: all matches of two scans, the right ones among them, the scans aligned.

`python docs/figures/home.py docs/images/home.png` makes that of the README, all panels side by side; with a
folder in place of the file, those of the site.
"""

from __future__ import annotations

import sys
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from PIL import Image

from cgroup import group
from cgroup.datasets import standin_pair
from cgroup.evaluation import correct_matches
from cgroup.plots import style
from cgroup.plots.shading import face_broadside, overlay, shade
from cgroup.registration import correspond
from cgroup.rigid import apply

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cgroup.plots.shading import Picture
    from cgroup.types import BoolArray, FloatArray

_SEED, _TURN = 1, 50.0
_GAP = 0.35  # between the scans, in widths of the target
_INK = {"light": "#222222", "dark": "#e6e6e6"}
_PANELS = ("matches", "group", "pose")
_RIGHT = "#00a878"


def make_figures(folder: Path) -> None:
    """Write three pictures for the light and the dark theme each, unless they are there."""
    newest = Path(__file__).stat().st_mtime
    paths = [folder / f"{name}-{theme}.png" for theme in _INK for name in _PANELS]
    if all(path.exists() and path.stat().st_mtime > newest for path in paths):
        return
    folder.mkdir(parents=True, exist_ok=True)
    scene = _Scene()
    for theme, ink in _INK.items():
        for name in _PANELS:
            scene.draw(name, ink).savefig(folder / f"{name}-{theme}.png", dpi=200, transparent=True)


def write_strip(path: Path) -> None:
    """Write all panels, side by side on white, into one file."""
    scene, panels = _Scene(), []
    for name in _PANELS:
        buffer = BytesIO()
        scene.draw(name, _INK["light"]).savefig(buffer, format="png", dpi=100, facecolor="white")
        panels.append(np.asarray(Image.open(buffer).convert("RGB")))
    Image.fromarray(np.concatenate(panels, axis=1)).quantize(128).save(path, optimize=True)


class _Scene:
    """Two scans, their matches, and what cgroup makes of them; the source is shown in the target's pose."""

    def __init__(self) -> None:
        pair = standin_pair(seed=_SEED, turn=_TURN)
        self.matches = correspond(pair.source, pair.target)
        self.found = group(self.matches, "lc")
        pose = self.found.transform()
        self.right = correct_matches(
            self.matches.source,
            self.matches.target,
            pair.T_target_source,
            tolerance=5 * float(self.matches.resolution or 1),
        )
        view = face_broadside(pair.target.points)
        placed = view.project(apply(pose, pair.source.points))
        target = view.project(pair.target.points)
        tints = (style.SOURCE_TINT, style.TARGET_TINT)
        self.pictures = shade(placed, tints[0]), shade(target, tints[1])
        self.aligned = overlay(placed, target, tints)
        left, right = (picture.extent for picture in self.pictures)
        self.shift = np.array([left[1] - right[0] + _GAP * (right[1] - right[0]), 0.0])
        starts = view.project(apply(pose, self.matches.source))[:, :2]
        ends = view.project(self.matches.target)[:, :2] + self.shift
        self.lines = np.stack([starts, ends], axis=1)

    def draw(self, name: str, ink: str) -> Figure:
        """Draw one panel; all are as large."""
        figure = Figure(figsize=(6, 4.3))
        axes = figure.add_axes((0.01, 0.01, 0.98, 0.78))
        found_right = self.found.mask & self.right
        if name == "pose":
            _show(axes, self.aligned, self.aligned.extent)
            _frame(axes, self.aligned.extent)
            title, note = "They give the pose", "the two scans aligned"
        else:
            self._draw_scans(axes)
            if name == "matches":
                self._draw_lines(axes, np.ones_like(self.right), style.WRONG, 0.3)
                title = "Two scans, matched"
                note = f"{len(self.right):,} matches, {(~self.right).sum():,} of them wrong"
            else:
                self._draw_lines(axes, self.found.mask & ~self.right, style.WRONG, 0.9)
                self._draw_lines(axes, found_right, _RIGHT, 0.85)
                title = "cgroup finds the right ones"
                note = f"{self.found.size} kept, {found_right.sum()} of them right"
        figure.text(0.5, 0.945, title, ha="center", va="center", fontsize=22, fontweight="bold", color=ink)
        figure.text(0.5, 0.845, note, ha="center", va="center", fontsize=18, color=ink)
        return figure

    def _extent(self, picture: Picture) -> tuple[float, float, float, float]:
        left, right, bottom, top = picture.extent
        return left + self.shift[0], right + self.shift[0], bottom, top

    def _draw_scans(self, axes: Axes) -> None:
        source, target = self.pictures
        _show(axes, source, source.extent)
        _show(axes, target, self._extent(target))
        _frame(axes, source.extent, self._extent(target))

    def _draw_lines(self, axes: Axes, rows: BoolArray, color: str, alpha: float) -> None:
        axes.add_collection(
            LineCollection(list(self.lines[rows]), colors=color, alpha=alpha, linewidths=0.8 + alpha)
        )


def _show(axes: Axes, picture: Picture, extent: tuple[float, float, float, float]) -> None:
    axes.imshow(picture.rgba, extent=extent, origin="lower", interpolation="antialiased")


def _frame(axes: Axes, *extents: tuple[float, float, float, float]) -> None:
    corners: FloatArray = np.array(extents)
    axes.set_xlim(corners[:, 0].min(), corners[:, 1].max())
    axes.set_ylim(corners[:, 2].min(), corners[:, 3].max())
    axes.set_aspect("equal")
    axes.set_axis_off()


if __name__ == "__main__":
    out = Path(sys.argv[1])
    (write_strip if out.suffix == ".png" else make_figures)(out)
