"""Build and check the source distribution, and the wheel from it in an empty folder: `make package`.

The Rust tests of the unpacked sources must compile, and pytest must collect the Python tests. The wheel must
contain the licences, and no path of the machine. On Linux, Zig links it for systems as old as PLATFORM, and
auditwheel and abi3audit check the symbols that it needs. Both files are kept in the given folder.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
from pathlib import Path

from check_wheels import check_wheel

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "target" / "package"
ON_LINUX = sys.platform == "linux"

PLATFORM = "manylinux_2_17"
"""Linux with a C library of 2012 or later, as old as Rust supports."""


def run(*command: str | Path, folder: Path, **environment: str | Path) -> str:
    """Run a command in a folder; return its output, or exit with it if the command fails."""
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    variables = os.environ | {"PATH": programs} | {name: str(value) for name, value in environment.items()}
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
    if ON_LINUX:
        pip += ["--config-settings", f"build-args=--zig --compatibility {PLATFORM}"]
    run(*pip, "--wheel-dir", out, sources, folder=sources, CARGO_TARGET_DIR=WORK)
    (wheel,) = out.glob("*.whl")
    return wheel


def audit_wheel(wheel: Path) -> None:
    """Exit if the wheel needs a newer system or Python than its name states."""
    shown = run(sys.executable, "-m", "auditwheel", "show", wheel, folder=wheel.parent)
    if f'"{PLATFORM}_' not in shown:
        raise SystemExit(shown)
    run("abi3audit", "--strict", wheel, folder=wheel.parent)


def check_sources(sources: Path, site: Path) -> int:
    """Compile the Rust tests and collect the Python tests; return how many these are."""
    run(
        "cargo", "test", "--release", "--locked", "--no-run", folder=sources, CARGO_TARGET_DIR=ROOT / "target"
    )
    pytest = [sys.executable, "-m", "pytest", "--collect-only", "--quiet", "-p", "no:cacheprovider"]
    collected = run(*pytest, folder=sources, PYTHONPATH=site)
    return int(re.findall(r"^(\d+)(?:/\d+)? tests collected", collected, re.MULTILINE)[0])


def as_new(member: tarfile.TarInfo, folder: str) -> tarfile.TarInfo:
    """Unpack a file with the current time; with the old time of the archive cargo would not compile it."""
    return tarfile.data_filter(member, folder).replace(mtime=time.time(), deep=False)


def main() -> None:
    """Build and check."""
    out = Path(sys.argv[1]).resolve()
    out.mkdir(parents=True, exist_ok=True)
    for old in [*out.glob("*.tar.gz"), *out.glob("*.whl")]:
        old.unlink()
    unpacked = WORK / "unpacked"  # the same each time, so that compiled crates can be used again
    shutil.rmtree(unpacked, ignore_errors=True)
    sdist = build_sdist(out)
    with tarfile.open(sdist) as archive:
        archive.extractall(unpacked, filter=as_new)  # noqa: S202 - it filters, and we have just made it
    (sources,) = unpacked.iterdir()
    wheel, site = build_wheel(sources, out), unpacked / "site"
    check_wheel(wheel, site)
    if ON_LINUX:
        audit_wheel(wheel)
    count = check_sources(sources, site)
    sys.stdout.write(
        f"{sdist.name}, {wheel.name}: complete, {count} Python tests, no folders of this machine\n"
    )


if __name__ == "__main__":
    main()
