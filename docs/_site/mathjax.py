"""MathJax without network: one script, with its fonts, from a package."""

from __future__ import annotations

from importlib.metadata import files

SCRIPT = "tex-svg.js"


def path() -> str:
    """Return where the script lies."""
    (found,) = (file for file in files("sphinx-mathjax-offline") or [] if file.name == SCRIPT)
    return str(found.locate())
