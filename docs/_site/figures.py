"""Figures of the pages, made when the site is built."""

from __future__ import annotations

import importlib
import sys
from typing import TYPE_CHECKING

from _site.progress import say

if TYPE_CHECKING:
    from pathlib import Path

_SCRIPTS = ("methods",)
"""Modules of docs/figures; each has ``make_figures(folder)``, and leaves alone what is up to date."""


def make(docs: Path) -> None:
    """Make what is missing below docs/_generated."""
    sys.path.insert(0, str(docs / "figures"))
    for name in _SCRIPTS:
        say(f"figures: {name}")
        folder = docs / "_generated" / name
        folder.mkdir(parents=True, exist_ok=True)
        importlib.import_module(name).make_figures(folder)
