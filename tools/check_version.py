"""Compares the places that name the version: `python tools/check_version.py [REF]`.

Cargo.toml has it; both lock files, CITATION.cff and the recipe for conda repeat it. For a tag (REF is
refs/tags/v1.2.3) the changelog has to have a dated section of that version. `--notes` prints this section.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

PLACES = {
    "Cargo.lock": r'^name = "cgroup(?:-py)?"\nversion = "(.+)"',
    "fuzz/Cargo.lock": r'^name = "cgroup"\nversion = "(.+)"',
    "CITATION.cff": r"^version: (.+)$",
    "conda/recipe.yaml": r'^  version: "(.+)"$',
}


def read_version(root: Path = ROOT) -> str:
    """Return the version that Cargo.toml names."""
    return _find(root / "Cargo.toml", r'^version = "(.+)"')[0]


def find_differences(root: Path = ROOT, ref: str = "") -> list[str]:
    """Return one line for each place that says something else than Cargo.toml."""
    version = read_version(root)
    lines = [
        f"{name}: {found}, but Cargo.toml has {version}"
        for name, form in PLACES.items()
        for found in _find(root / name, form) or ["no version"]
        if found != version
    ]
    tag = ref.removeprefix("refs/tags/v")
    if tag == ref:
        return lines
    if tag != version:
        lines.append(f"tag: v{tag}, but Cargo.toml has {version}")
    if read_notes(root) is None:
        lines.append(f"CHANGELOG.md: no section `## {version} - YYYY-MM-DD`")
    return lines


def read_notes(root: Path = ROOT) -> str | None:
    """Return the changelog's dated section of the version, if any."""
    heading = rf"^## {re.escape(read_version(root))} - \d{{4}}-\d\d-\d\d$\n(.*?)(?=^## |\Z)"
    found = _find(root / "CHANGELOG.md", heading, re.DOTALL)
    return found[0].strip() + "\n" if found else None


def _find(path: Path, form: str, flags: int = 0) -> list[str]:
    return re.findall(form, path.read_text(encoding="utf-8"), re.MULTILINE | flags)


def main() -> None:
    """Check, or print the notes."""
    argument = "".join(sys.argv[1:2])
    if argument == "--notes":
        sys.stdout.write(read_notes() or "")
    elif lines := find_differences(ref=argument):
        raise SystemExit("\n".join(lines))
    else:
        sys.stdout.write(f"{read_version()} everywhere\n")


if __name__ == "__main__":
    main()
