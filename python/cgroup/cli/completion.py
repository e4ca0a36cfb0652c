"""Complete words in the shell: methods, presets and saved runs."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import resources

from cgroup.registry import METHOD_INFO


def complete_methods(incomplete: str) -> Iterator[tuple[str, str]]:
    """Offer the names of methods, in the case that was begun with."""
    for name, info in METHOD_INFO.items():
        offered = name.upper() if incomplete.isupper() else name
        if offered.startswith(incomplete):
            yield offered, f"{info.label}, {info.citation}"


def complete_presets(incomplete: str) -> Iterator[str]:
    """Offer the configurations that come with the package; files are the shell's own."""
    for entry in (resources.files("cgroup.benchmark") / "presets").iterdir():
        name, dot, suffix = entry.name.partition(".")
        if dot and suffix == "toml" and name.startswith(incomplete):
            yield name


def complete_runs(incomplete: str) -> Iterator[str]:
    """Offer the names of saved runs."""
    from cgroup.cli.saved_runs import names_of_runs  # noqa: PLC0415 - only here

    return (name for name in names_of_runs() if name.startswith(incomplete))
