"""Why claims came out as they did, found out by people and kept beside the claims."""

from __future__ import annotations

import sys
from importlib.resources import files

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib  # pyright: ignore[reportMissingImports] - on Python 3.10 only


def read_explanations() -> dict[str, str]:
    """Texts by claim.

    Returns
    -------
    dict of str to str
        By the claim's id; only for claims that somebody has looked into.
    """
    text = files("cgroup.benchmark.claims").joinpath("explanations.toml").read_text(encoding="utf-8")
    return {name: str(value) for name, value in tomllib.loads(text).items()}
