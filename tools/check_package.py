"""Builds the source distribution, and the wheel from it in an empty folder, and checks both: `make package`.

The tests of the unpacked sources have to be found and to compile; the wheel has to hold the licences,
and must not tell where it was built. What was built stays in the folder that is named.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LICENSES = {"LICENSE-MIT", "LICENSE-APACHE", "THIRD-PARTY-LICENSES.txt"}

# Folders of people and of machines; the compiler's own and the names given in build_backend.py are none.
FOLDER = re.compile(rb"(?:/root|/home|/Users|/tmp|/work|/var|[A-Z]:\\)[/\\][\w./\\-]*")


def run(*command: str | Path, folder: Path, **environment: str | Path) -> str:
    """Run a command in a folder; return what it prints, or end with it where it fails."""
    variables = os.environ | {name: str(value) for name, value in environment.items()}
    done = subprocess.run(  # noqa: S603
        command,
        cwd=folder,
        env=variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    if done.returncode:
        raise SystemExit(done.stdout + f"failed: {' '.join(map(str, command))}")
    return done.stdout


def build_sdist(out: Path) -> Path:
    """Return the source distribution, built in `out`."""
    code = f"import build_backend; build_backend.build_sdist({str(out)!r})"
    run(sys.executable, "-c", code, folder=ROOT, PYTHONPATH=ROOT / "tools")
    (sdist,) = out.glob("*.tar.gz")
    return sdist


def build_wheel(sources: Path, out: Path) -> Path:
    """Return the wheel, built of the unpacked sources by pip as a user does."""
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    run(*pip, "--wheel-dir", out, sources, folder=sources, CARGO_TARGET_DIR=ROOT / "target" / "package")
    (wheel,) = out.glob("*.whl")
    return wheel


def check_wheel(wheel: Path, site: Path) -> None:
    """Unpack the wheel; end where it lacks a licence or tells of folders."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)  # noqa: S202 - we have just made it
    missing = LICENSES - {path.name for path in site.glob("*.dist-info/licenses/*")}
    if missing:
        message = f"{wheel.name} lacks {', '.join(sorted(missing))}"
        raise SystemExit(message)
    for path in filter(Path.is_file, site.rglob("*")):
        if found := FOLDER.search(path.read_bytes()):
            message = f"{wheel.name}: {path.relative_to(site)} tells of {found[0].decode()}"
            raise SystemExit(message)


def check_sources(sources: Path, site: Path) -> int:
    """Compile the Rust tests and collect the Python tests; return how many these are."""
    run(
        "cargo", "test", "--release", "--locked", "--no-run", folder=sources, CARGO_TARGET_DIR=ROOT / "target"
    )
    pytest = [sys.executable, "-m", "pytest", "--collect-only", "--quiet", "-p", "no:cacheprovider"]
    collected = run(*pytest, folder=sources, PYTHONPATH=site)
    return int(re.findall(r"^(\d+) tests collected", collected, re.MULTILINE)[0])


def main() -> None:
    """Build and check."""
    out = Path(sys.argv[1]).resolve()
    out.mkdir(parents=True, exist_ok=True)
    for old in [*out.glob("*.tar.gz"), *out.glob("*.whl")]:
        old.unlink()
    with tempfile.TemporaryDirectory() as folder:
        sdist = build_sdist(out)
        with tarfile.open(sdist) as archive:
            archive.extractall(folder, filter="data")
        (sources,) = Path(folder).iterdir()
        wheel, site = build_wheel(sources, out), Path(folder) / "site"
        check_wheel(wheel, site)
        count = check_sources(sources, site)
    sys.stdout.write(
        f"{sdist.name}, {wheel.name}: complete, {count} Python tests, no folders of this machine\n"
    )


if __name__ == "__main__":
    main()
