"""Figures as files of the run's folder, and as pictures in the page."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

from cgroup.io import write_file
from cgroup.io._results import make_folder
from cgroup.plots.style import method_styles

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from pathlib import Path

    from matplotlib.figure import Figure

RESOLUTION, CLOUD_RESOLUTION = 150, 100
"""Dots per inch of PNG files; pictures of clouds are wide."""

QUALITY = 80
"""Of pictures in the page, of 100."""


@dataclass(frozen=True)
class Picture:
    """A figure in the page.

    Attributes
    ----------
    name : str
        Of its files, without the ending.
    alt : str
        What it shows, for those who don't see it.
    data : str
        The picture as base64, in the format WebP.
    """

    name: str
    alt: str
    data: str


class PictureBook:
    """Saves figures in the folder, and keeps for the page those that it has no chart of.

    Parameters
    ----------
    folder : path
        Made if it isn't there.
    tell : callable
        Called with what is being drawn.
    methods : iterable of str
        All that the report shows, in the order in which looks are given to those from outside.

    Attributes
    ----------
    styles : dict of str to MethodStyle
        How methods are drawn in all figures and charts.
    """

    def __init__(self, folder: Path, tell: Callable[[str], Any], methods: Iterable[str]) -> None:
        self.styles = method_styles(methods)
        self._folder = folder
        self._tell = tell
        make_folder(folder)

    def save(self, name: str, figure: Figure, *, resolution: int = RESOLUTION) -> str:
        """Save a figure as PNG and PDF; returns its name."""
        self._tell(f"figure {name}")
        write_file(self._folder / f"{name}.png", _render_figure(figure, "png", resolution))
        figure.set_layout_engine("none")  # it is laid out; doing so again takes as long as drawing
        write_file(self._folder / f"{name}.pdf", _render_figure(figure, "pdf", resolution))
        return name

    def keep(self, name: str, figure: Figure, alt: str) -> Picture:
        """Save a figure, and keep it as a picture."""
        self.save(name, figure, resolution=CLOUD_RESOLUTION)
        small = _render_figure(figure, "webp", CLOUD_RESOLUTION, pil_kwargs={"quality": QUALITY})
        return Picture(name, alt, base64.b64encode(small).decode())


def _render_figure(figure: Figure, kind: str, resolution: int, **options: Any) -> bytes:  # noqa: ANN401 - matplotlib's
    buffer = BytesIO()
    # A date would make the same figure another file each time.
    metadata = {"metadata": {"CreationDate": None}} if kind == "pdf" else {}
    figure.savefig(buffer, format=kind, dpi=resolution, **metadata, **options)
    return buffer.getvalue()
