"""The picture of the home page: two real scans, the matches that cgroup keeps, and how far they are apart.

`python docs/figures/home.py DATA` draws it from two views of the Stanford bunny in a folder with data (see
docs/datasets.md): its panels for the site, and all side by side for the README. The views are not part of the
repository; the pictures are.
"""

from __future__ import annotations

import sys
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from cgroup.datasets import open_dataset
from cgroup.evaluation import correct_matches
from cgroup.plots.matches import PairDrawing
from cgroup.registration import register

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PAIR = "bunny/bun045-bun315"
_IMAGES = Path(__file__).parents[1] / "images"
_INK = "#808080"  # legible on light and on dark pages
_METHOD = Image.Quantize.FASTOCTREE  # the others merge the rare colours of the bar
_HEIGHT, _TEXT = 4.3, 0.9  # inches: of a panel, and of the title on top


class Panels:
    """Two scans as they came, their matches, and what cgroup makes of them."""

    def __init__(self, root: Path) -> None:
        pair = open_dataset("stanford", root).load(_PAIR)
        self._done = register(pair.source, pair.target, viewpoint=pair.source_viewpoint)
        self._matches = self._done.correspondences
        tolerance = 5 * self._done.resolution
        ends = self._matches.source, self._matches.target
        self._right = correct_matches(*ends, pair.T_target_source, tolerance=tolerance)
        clouds = pair.source.points, pair.target.points
        self._apart, self._placed = (
            PairDrawing(*clouds, pose) for pose in (np.eye(4), self._done.T_target_source)
        )

    def draw(self, name: str) -> tuple[Figure, str, str]:
        """Draw one panel, below an empty strip; return it, its title and a note."""
        figure = Figure(figsize=(6, _HEIGHT))
        axes = figure.add_axes((0.01, 0.01, 0.98, 0.98 - _TEXT / _HEIGHT))
        kept, right = self._done.grouping.mask, self._right
        if name == "agreement":
            self._draw_agreement(figure, axes)
            return figure, "They give the pose", "coloured by distance"
        self._apart.draw_clouds(axes)
        shown = kept if name == "group" else np.ones_like(kept)
        self._apart.draw_selection(axes, self._matches, shown, right)
        if name == "group":
            note = f"{kept.sum()} kept, {(kept & right).sum()} of them right"
            return figure, "cgroup finds the right ones", note
        return figure, "Two scans, matched", f"{len(right):,} matches, {(~right).sum():,} of them wrong"

    def _draw_agreement(self, figure: Figure, axes: Axes) -> None:
        axes.set_position((0.0, 0.01, 0.74, 0.98 - _TEXT / _HEIGHT))
        colors = self._placed.draw_agreement(axes, self._matches)
        bar = figure.colorbar(colors, cax=figure.add_axes((0.76, 0.26, 0.03, 0.36)), extend="max")
        ticks = np.array([0.0, 0.5, 1.0]) * colors.get_clim()[1]
        bar.set_ticks(
            ticks, labels=[f"{1000 * tick:.1f}" for tick in ticks], color=_INK, fontsize=17
        )  # m to mm
        bar.ax.tick_params(color=_INK)
        bar.ax.set_title("mm", color=_INK, fontsize=17, pad=12)
        bar.ax.text(
            0,
            -0.32,
            "grey: in one\nscan only",
            color=_INK,
            fontsize=17,
            va="center",
            transform=bar.ax.transAxes,
        )
        bar.outline.set_visible(False)


def main(root: Path) -> None:
    """Write all pictures."""
    panels, strip = Panels(root), []
    for name in ("matches", "group", "agreement"):
        figure, title, note = panels.draw(name)
        buffer = BytesIO()
        figure.savefig(buffer, format="png", dpi=130, transparent=True)
        panel = Image.open(buffer)
        top = round(panel.height * _TEXT / _HEIGHT)
        panel.crop((0, top, panel.width, panel.height)).quantize(256, _METHOD).save(
            _IMAGES / f"home-{name}.png", optimize=True
        )
        for text, size, weight, height in ((title, 24, "bold", 0.945), (note, 20, "normal", 0.855)):
            figure.text(0.5, height, text, ha="center", va="center", fontsize=size, fontweight=weight)
        buffer = BytesIO()
        figure.savefig(buffer, format="png", dpi=100, facecolor="white")
        strip.append(np.asarray(Image.open(buffer).convert("RGB")))
    Image.fromarray(np.concatenate(strip, axis=1)).quantize(256, _METHOD).save(
        _IMAGES / "home.png", optimize=True
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
