"""Make the figures of the methods' pages.

``python docs/figures/methods.py FOLDER`` writes ``<name>-idea.png``, ``<name>-options.png``,
``<name>-limits.png`` and ``<name>-cost.png`` of every method, and ``chooser.html``, into the folder,
unless they are up to date.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl

import cgroup
from method_figures.chooser import render_chooser
from method_figures.draw_limits import draw_cost, draw_limits
from method_figures.draw_options import draw_options
from method_figures.ideas import IDEAS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.figure import Figure

KINDS = ("idea", "options", "limits", "cost")
_STAMP = "made-from.txt"
_SOURCES = Path(__file__).parent


def make_figures(folder: Path) -> None:
    """Write all figures and the chooser into a folder, unless they exist; make the folder."""
    stamp = _state()
    marker = folder / _STAMP
    if (
        marker.is_file()
        and marker.read_text(encoding="utf-8") == stamp
        and all(map(Path.is_file, files(folder)))
    ):
        return
    folder.mkdir(parents=True, exist_ok=True)
    for name, kind, figure in _draw_all():
        figure.savefig(folder / f"{name}-{kind}.png", facecolor="white", metadata={"Software": None})
    (folder / "chooser.html").write_text(render_chooser(), encoding="utf-8")
    marker.write_text(stamp, encoding="utf-8")


def files(folder: Path) -> list[Path]:
    """Return the paths of the files that `make_figures` writes."""
    return [*(folder / f"{name}-{kind}.png" for name in IDEAS for kind in KINDS), folder / "chooser.html"]


def _draw_all() -> Iterator[tuple[str, str, Figure]]:
    for name, draw in IDEAS.items():
        yield name, "idea", draw()
        yield name, "options", draw_options(name)
        yield name, "limits", draw_limits(name)
        yield name, "cost", draw_cost(name)


def _state() -> str:
    """Say what the figures depend on: what draws them, and in which version, and what was measured."""
    digest = hashlib.sha256()
    for path in sorted(_SOURCES.rglob("*")):
        if path.suffix in {".py", ".csv", ".html"}:
            digest.update(path.read_bytes())
    return f"cgroup {cgroup.__version__}, matplotlib {mpl.__version__}, sources {digest.hexdigest()}\n"


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.stderr.write(__doc__ or "")
        sys.exit(2)
    make_figures(Path(sys.argv[1]))
