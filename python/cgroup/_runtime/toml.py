"""The standard library's TOML parser, or its backport on Python 3.10."""

import sys

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports] - on Python 3.10 only

__all__ = ["tomllib"]
