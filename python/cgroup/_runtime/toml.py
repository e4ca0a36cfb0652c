"""The standard library's TOML parser, or its backport on Python 3.10, and texts of the package."""

import sys
from importlib.resources import files
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports] - on Python 3.10 only

__all__ = ["load_packaged", "read_packaged", "tomllib"]


def read_packaged(package: str, name: str) -> str:
    """Return a text file of the package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def load_packaged(package: str, name: str) -> dict[str, Any]:
    """Return the tables of a TOML file of the package."""
    return tomllib.loads(read_packaged(package, name))
