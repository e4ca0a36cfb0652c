"""Figures as files of the run's folder, and as pictures in the page."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from cgroup.io import write_file
from cgroup.io.result_folders import make_folder
from cgroup.plots.style import method_styles

RESOLUTION, CLOUD_RESOLUTION = 150, 100
"""Dots per inch of PNG files; pictures of clouds are wider."""

QUALITY = 80
"""Quality of pictures in the page, of 100."""


class Picture(NamedTuple):
    """A figure in the page: the name of its files, a description, and the picture (WebP) as base64."""

    name: str
    alt: str
    data: str


class PictureBook:
    """Saves figures in a folder, and makes pictures of those that have no chart in the page.

    `tell` is called with the name of each figure. `methods` are all methods of the report; `styles` has the
    looks of each in all figures and charts.
    """

    def __init__(self, folder: Path, tell: Callable[[str], Any], methods: Iterable[str]) -> None:
        self.styles = method_styles(methods)
        self._folder = folder
        self._tell = tell
        make_folder(folder)

    def save(self, name: str, figure: Figure, *, resolution: int = RESOLUTION) -> str:
        """Save a figure as PNG and PDF; return its name."""
        self._tell(f"figure {name}")
        write_file(self._folder / f"{name}.png", _render_figure(figure, "png", resolution))
        figure.set_layout_engine("none")  # a second layout would take as long as drawing
        write_file(self._folder / f"{name}.pdf", _render_figure(figure, "pdf", resolution))
        return name

    def keep(self, name: str, figure: Figure, alt: str) -> Picture:
        """Save a figure, and return it as a picture."""
        self.save(name, figure, resolution=CLOUD_RESOLUTION)
        small = _render_figure(figure, "webp", CLOUD_RESOLUTION, pil_kwargs={"quality": QUALITY})
        return Picture(name, alt, base64.b64encode(small).decode())


def _render_figure(figure: Figure, kind: str, resolution: int, **options: Any) -> bytes:  # noqa: ANN401 - matplotlib's
    buffer = BytesIO()
    # A date would make every file of the same figure different.
    metadata = {"metadata": {"CreationDate": None}} if kind == "pdf" else {}
    figure.savefig(buffer, format=kind, dpi=resolution, **metadata, **options)
    return buffer.getvalue()
