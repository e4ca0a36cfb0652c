"""Set up what the peers need, as far as this machine can, and say of the others why they are left out."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cgroup import _core
from cgroup.benchmark.results import this_machine

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from peers.catalogue import Peer

HERE = Path(__file__).resolve().parent
BENCHES = HERE.parent
PACKAGES = {
    "open3d": "open3d",
    "pygcransac": "pygcransac",
    "kiss_matcher": "kiss-matcher",
    "torch": "torch",
    "networkx": "networkx",
}
"""What the libraries are called on PyPI."""

BUILT = {"_teaserpp": "TEASER++", "clipperpy": "CLIPPER"}
"""What has to be built, with its Python bindings."""

TITLES = {**PACKAGES, **BUILT}

PCL_PACKAGES = "apt-get install libpcl-dev cmake"
WITHOUT_PCL = 'Could not find a package configuration file provided by "PCL"'
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class MissingError(Exception):
    """A program or library can't be had here; the message says why."""


@dataclass
class Environment:
    """How to start each peer.

    Attributes
    ----------
    commands : dict of str to tuple of str
        What to run, by program or module; the rest of the command line names the peer and its case.
    versions : dict of str to str
        Of all libraries.
    missing : dict of str to str
        Why a program or module is not there.
    """

    commands: dict[str, tuple[str, ...]] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)

    def command(self, peer: Peer, case: Path, threads: int) -> list[str]:
        """Command line that runs a peer on a case."""
        start = self.commands[needs(peer)]
        if peer.program == "pcl":
            return [*start, peer.name.removeprefix("pcl_"), str(case)]
        return [*start, "-m", "peers.measure", peer.program, peer.name, str(case), str(threads)]

    def why_missing(self, peer: Peer) -> str:
        """Why a peer can't run; empty if it can."""
        return self.missing.get(needs(peer), "")


def needs(peer: Peer) -> str:
    """Name what has to be there for a peer."""
    return peer.module or peer.program


def prepare(peers: Iterable[Peer], *, venv: Path, build: Path, say: Callable[[str], object]) -> Environment:
    """Set up what these peers need."""
    environment = Environment(
        {"cgroup": (sys.executable,), "numpy": (sys.executable,)},
        {name: metadata.version(name) for name in ("numpy", "scipy")} | {"cgroup": _core.__version__},
    )
    for name in dict.fromkeys(needs(peer) for peer in peers):
        if name not in environment.commands:
            _add(environment, name, venv, build, say)
    return environment


def _add(environment: Environment, name: str, venv: Path, build: Path, say: Callable[[str], object]) -> None:
    """Set up PCL or a library, or note why it can't be had."""
    title = TITLES.get(name, "PCL")
    try:
        if name == "pcl":
            program = build_pcl(build, say)
            version = _run([str(program), "version"]).stdout.strip()
        else:
            program = make_venv(venv, say)
            version = install(program, name, say)
    except MissingError as reason:
        environment.missing[name] = str(reason)
        say(f"{title} is left out: {reason}")
    else:
        environment.commands[name] = (str(program),)
        environment.versions[title] = version


def build_pcl(build: Path, say: Callable[[str], object]) -> Path:
    """Build the program that runs PCL's methods."""
    if shutil.which("cmake") is None:
        message = f"cmake is missing; {PCL_PACKAGES}"
        raise MissingError(message)
    program = build / "pcl_peers"
    if not program.exists():
        say("Building the PCL peers (a minute or two the first time) ...")
    done = _run(["cmake", "-S", str(HERE), "-B", str(build)])
    if WITHOUT_PCL in done.stderr:
        message = f"PCL is missing; {PCL_PACKAGES}"
        raise MissingError(message)
    if done.returncode == 0:
        done = _run(["cmake", "--build", str(build)])
    if done.returncode != 0:
        log = build / "failure.log"
        log.parent.mkdir(parents=True, exist_ok=True)
        log.write_text(done.stdout + done.stderr, encoding="utf-8")
        message = f"it does not build, see {log}"
        raise MissingError(message)
    return program


def make_venv(venv: Path, say: Callable[[str], object]) -> Path:
    """Make the environment of the libraries, apart from cgroup's own; its Python."""
    python = venv / "bin" / "python"
    if not python.exists():
        say(f"Making {venv.name} for the libraries from pip ...")
        done = _run([sys.executable, "-m", "venv", str(venv)])
        if done.returncode != 0:
            message = f"no virtual environment: {_last_line(done)}"
            raise MissingError(message)
    return python


def install(python: Path, module: str, say: Callable[[str], object]) -> str:
    """Install a library unless it is there; its version."""
    found = _version(python, module)
    if found.returncode != 0 and module in BUILT:
        message = "build it from its repository with its Python bindings, and put their folder on PYTHONPATH"
        raise MissingError(message)
    if found.returncode != 0:
        say(f"Installing {PACKAGES[module]} ...")
        pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        done = _run([*pip, "--retries=1", "--only-binary=:all:", "numpy", PACKAGES[module]])
        if done.returncode != 0:
            message = f"pip has none for Python {platform.python_version()} here: {_last_line(done)}"
            raise MissingError(message)
        found = _version(python, module)
    if found.returncode != 0:
        message = f"it does not import ({_last_line(found)})"
        raise MissingError(message)
    return found.stdout.split()[-1]


def _version(python: Path, module: str) -> subprocess.CompletedProcess[str]:
    if module in BUILT:
        code = f"import {module}; print(getattr({module}, '__version__', 'of unknown version'))"
    else:
        code = (
            f"import {module}; from importlib.metadata import version; print(version({PACKAGES[module]!r}))"
        )
    return _run([str(python), "-c", code])


def child_environment(threads: int) -> dict[str, str]:
    """Environment variables of one run."""
    paths = [str(BENCHES), *filter(None, [os.environ.get("PYTHONPATH")])]
    limits = dict.fromkeys(THREAD_VARIABLES, str(threads))
    return {**os.environ, **limits, "PYTHONPATH": os.pathsep.join(paths)}


def describe(environment: Environment) -> dict[str, Any]:
    """Describe machine and libraries; what the figures depend on stands under "identity"."""
    machine = this_machine()
    build = hashlib.sha256(Path(_core.__file__).read_bytes()).hexdigest()[:12]
    return {
        "identity": {"cpu": machine.cpu, "cores": machine.cores, "build": build, "numpy": machine.numpy},
        "system": machine.system,
        "python": machine.python,
        "load": os.getloadavg()[0],
        "versions": environment.versions,
        "missing": environment.missing,
    }


def _run(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, check=False)


def _last_line(done: subprocess.CompletedProcess[str]) -> str:
    lines = [line for line in (done.stdout + done.stderr).splitlines() if line.strip()]
    return lines[-1].strip() if lines else f"exit code {done.returncode}"
