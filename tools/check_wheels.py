"""Checks what is about to be uploaded: `python tools/check_wheels.py FOLDER`.

Every wheel has to hold the licences and must not tell where it was built; every platform has to have its two
wheels, one for CPython 3.10 and later, one for 3.14 without the global lock; and there has to be one sdist.
"""

from __future__ import annotations

import re
import sys
import tempfile
import zipfile
from pathlib import Path

LICENSES = {"LICENSE-MIT", "LICENSE-APACHE", "THIRD-PARTY-LICENSES.txt"}

# Folders of people and of machines; the compiler's own and the names given in build_backend.py are none.
FOLDER = re.compile(rb"(?:/root|/home|/Users|/tmp|/work|/var|[A-Za-z]:[/\\](?:Users|a))[/\\][\w./\\-]*")

PLATFORMS = (
    "manylinux.*_x86_64",
    "manylinux.*_aarch64",
    "musllinux.*_x86_64",
    "musllinux.*_aarch64",
    "macosx.*_x86_64",
    "macosx.*_arm64",
    "win_amd64",
)
PYTHONS = ("cp310-abi3", "cp314-cp314t")


def check_wheel(wheel: Path, site: Path) -> None:
    """Unpack a wheel; end where it lacks a licence or tells of folders."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    missing = LICENSES - {path.name for path in site.glob("*.dist-info/licenses/*")}
    if missing:
        message = f"{wheel.name} lacks {', '.join(sorted(missing))}"
        raise SystemExit(message)
    for path in filter(Path.is_file, site.rglob("*")):
        if found := FOLDER.search(path.read_bytes()):
            message = f"{wheel.name}: {path.relative_to(site)} tells of {found[0].decode()}"
            raise SystemExit(message)


def find_gaps(names: list[str]) -> list[str]:
    """Return the missing files of a release."""
    wanted = {
        f"a wheel {python}-{platform}": rf"cgroup-[\d.]+-{python}-{platform}\.whl"
        for python in PYTHONS
        for platform in PLATFORMS
    }
    wanted["a source distribution"] = r"cgroup-[\d.]+\.tar\.gz"
    return [what for what, form in wanted.items() if not any(re.fullmatch(form, name) for name in names)]


def main() -> None:
    """Check a folder."""
    files = sorted(Path(sys.argv[1]).iterdir())
    if gaps := find_gaps([file.name for file in files]):
        message = f"{sys.argv[1]} lacks {', '.join(gaps)}"
        raise SystemExit(message)
    for wheel in files:
        if wheel.suffix == ".whl":
            with tempfile.TemporaryDirectory() as site:
                check_wheel(wheel, Path(site))
        sys.stdout.write(f"{wheel.name}: complete\n")


if __name__ == "__main__":
    main()
