"""Builds sdists and wheels by maturin, without the paths of the machine that they are built on.

The compiled core holds the places of its panics, and so the folder of the crates' sources: the home of
whoever builds it. pip and `python -m build` come through here and have it replaced; `maturin develop`,
which developers use, does not.
"""

from __future__ import annotations

import os
from pathlib import Path

import maturin
from maturin import (
    build_editable,
    build_sdist,
    get_requires_for_build_editable,
    get_requires_for_build_sdist,
    get_requires_for_build_wheel,
    prepare_metadata_for_build_wheel,
)

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_wheel",
]


def build_wheel(
    wheel_directory: str,
    config_settings: dict[str, object] | None = None,
    metadata_directory: str | None = None,
) -> str:
    """Build a wheel; return its name."""
    _forget_folders()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def _forget_folders() -> None:
    """Have cargo hand the compiler other names for the folders of this machine, behind its other flags."""
    separator = "\x1f"  # flags may have blanks in them, as folders do
    flags = os.environ.get("CARGO_ENCODED_RUSTFLAGS", "").split(separator)
    flags += [] if any(flags) else os.environ.get("RUSTFLAGS", "").split()
    crates = Path(os.environ.get("CARGO_HOME", Path.home() / ".cargo"))
    flags += [f"--remap-path-prefix={crates}=/cargo", f"--remap-path-prefix={Path.cwd()}=/cgroup"]
    os.environ["CARGO_ENCODED_RUSTFLAGS"] = separator.join(filter(None, flags))
