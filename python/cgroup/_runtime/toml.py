"""The standard library's TOML parser, or its backport on Python 3.10."""

import sys
from importlib.resources import files
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports] - on Python 3.10 only

__all__ = ["load_packaged", "tomllib"]


def load_packaged(package: str, name: str) -> dict[str, Any]:
    """Return the tables of a TOML file of the package."""
    return tomllib.loads(files(package).joinpath(name).read_text(encoding="utf-8"))
