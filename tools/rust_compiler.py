"""Finds out whether there is a Rust compiler that can build cgroup."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

MANIFEST = Path(__file__).resolve().parents[1] / "Cargo.toml"
REMEDY = (
    "install or update Rust from https://rustup.rs and try again, "
    "or take a wheel (pip install --only-binary cgroup cgroup)"
)


def find_problem() -> str | None:
    """Say in one sentence why cgroup can't be built here and what to do; None if it can."""
    needed = _least_version()
    start = f"cgroup can't be built: it is compiled by Rust {needed} or newer"
    for program in ("cargo", "rustc"):
        if shutil.which(program) is None:
            return f"{start}, and there is no `{program}` on the PATH; {REMEDY}."
    answer = _ask_version()
    found = re.match(r"rustc (\d+)\.(\d+)", answer)
    if found is None:
        return f"{start}, and `rustc --version` answers {answer!r}; {REMEDY}."
    if tuple(map(int, found.groups())) < tuple(map(int, needed.split("."))):
        return f"{start}, and this is {answer}; {REMEDY}."
    return None


def _least_version() -> str:
    """Return the `rust-version` of the manifest, such as 1.89."""
    found = re.search(r'^rust-version = "(\d+\.\d+)', MANIFEST.read_text(encoding="utf-8"), re.MULTILINE)
    return found[1] if found else "1.0"


def _ask_version() -> str:
    """Return the first line that the compiler says of itself, or of why it does not start."""
    done = subprocess.run(
        ["rustc", "--version"],  # noqa: S607 - cargo takes the one on the PATH, too
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        check=False,
    )
    return (done.stdout.strip().splitlines() or [""])[0]
