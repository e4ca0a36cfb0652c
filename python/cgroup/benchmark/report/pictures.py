"""Figures as files of the run's folder, and as pictures in the page."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

from cgroup.io import write_file
from cgroup.io._results import make_folder

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from matplotlib.figure import Figure

RESOLUTION, CLOUD_RESOLUTION = 150, 100
"""Dots per inch of PNG files; pictures of clouds are wide."""


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
        The PNG as base64.
    """

    name: str
    alt: str
    data: str


class PictureBook:
    """Saves figures in the folder, and keeps them for the page."""

    def __init__(self, folder: Path, tell: Callable[[str], Any]) -> None:
        self._folder = folder
        self._tell = tell
        make_folder(folder)

    def add(self, name: str, figure: Figure, alt: str, *, resolution: int = RESOLUTION) -> Picture:
        """Save a figure as PNG and PDF."""
        self._tell(f"figure {name}")
        png = _render_figure(figure, "png", resolution)
        write_file(self._folder / f"{name}.png", png)
        figure.set_layout_engine("none")  # it is laid out; doing so again takes as long as drawing
        write_file(self._folder / f"{name}.pdf", _render_figure(figure, "pdf", resolution))
        return Picture(name, alt, base64.b64encode(png).decode())


def _render_figure(figure: Figure, kind: str, resolution: int) -> bytes:
    buffer = BytesIO()
    # A date would make the same figure another file each time.
    metadata = {"CreationDate": None} if kind == "pdf" else {}
    figure.savefig(buffer, format=kind, dpi=resolution, metadata=metadata)
    return buffer.getvalue()
