"""Colour text on terminals that support colours, unless NO_COLOR is set."""

from __future__ import annotations

import os
import sys
from typing import Any

import typer


def paint(text: str, **style: Any) -> str:  # noqa: ANN401 - as `typer.style` takes it
    """Return a text in a style, or as it is."""
    return typer.style(text, **style) if wants_colors() else text


def wants_colors() -> bool:
    """Whether standard output is a terminal with colours: not piped, no NO_COLOR, not TERM=dumb."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return sys.stdout.isatty()
