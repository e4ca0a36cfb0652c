"""MathJax without network: one script, with its fonts, from a package."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, files

_PACKAGE = "sphinx-mathjax-offline"
_SCRIPT = "tex-svg.js"


def script() -> list[str]:
    """Return the path of the script; none where the package is missing."""
    try:
        return [str(path.locate()) for path in files(_PACKAGE) or [] if path.name == _SCRIPT]
    except PackageNotFoundError:
        return []


def path() -> str:
    """Return what pages load: the script of the package, or else the one on the network."""
    return _SCRIPT if script() else f"https://cdn.jsdelivr.net/npm/mathjax@3/es5/{_SCRIPT}"
