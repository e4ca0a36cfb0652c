"""Builds sdists and wheels by maturin: it looks for Rust first, and leaves no paths of the machine behind.

Without Rust, or with one that is too old, every hook ends with one sentence instead of a traceback, and no
compiler is downloaded unasked.

The compiled core holds the places of its panics, and so the folder of the crates' sources: the home of
whoever builds it. pip and `python -m build` come through here and have it replaced; `maturin develop`,
which developers use, does not.
"""

from __future__ import annotations

import functools
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import maturin
import rust_compiler

if TYPE_CHECKING:
    from collections.abc import Callable

Hook = TypeVar("Hook", bound="Callable[..., object]")

__all__ = [
    "build_editable",
    "build_sdist",
    "build_wheel",
    "get_requires_for_build_editable",
    "get_requires_for_build_sdist",
    "get_requires_for_build_wheel",
    "prepare_metadata_for_build_editable",
    "prepare_metadata_for_build_wheel",
]


def _with_rust(hook: Hook) -> Hook:
    """Have a hook look for Rust before it starts; pip shows what it prints, and nothing else if it exits."""

    @functools.wraps(hook)
    def checked(*args: object, **options: object) -> object:
        if problem := rust_compiler.find_problem():
            sys.stderr.write(f"{problem}\n")
            sys.exit(1)
        return hook(*args, **options)

    return checked  # type: ignore[return-value]


@_with_rust
def build_wheel(
    wheel_directory: str,
    config_settings: dict[str, object] | None = None,
    metadata_directory: str | None = None,
) -> str:
    """Build a wheel; return its name."""
    _forget_folders()
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


build_editable = _with_rust(maturin.build_editable)
build_sdist = _with_rust(maturin.build_sdist)
get_requires_for_build_editable = _with_rust(maturin.get_requires_for_build_editable)
get_requires_for_build_sdist = _with_rust(maturin.get_requires_for_build_sdist)
get_requires_for_build_wheel = _with_rust(maturin.get_requires_for_build_wheel)
prepare_metadata_for_build_editable = _with_rust(maturin.prepare_metadata_for_build_editable)
prepare_metadata_for_build_wheel = _with_rust(maturin.prepare_metadata_for_build_wheel)


def _forget_folders() -> None:
    """Have cargo hand the compiler other names for the folders of this machine, behind its other flags."""
    separator = "\x1f"  # flags may have blanks in them, as folders do
    flags = os.environ.get("CARGO_ENCODED_RUSTFLAGS", "").split(separator)
    flags += [] if any(flags) else os.environ.get("RUSTFLAGS", "").split()
    crates = Path(os.environ.get("CARGO_HOME", Path.home() / ".cargo"))
    flags += [f"--remap-path-prefix={crates}=/cargo", f"--remap-path-prefix={Path.cwd()}=/cgroup"]
    os.environ["CARGO_ENCODED_RUSTFLAGS"] = separator.join(filter(None, flags))
