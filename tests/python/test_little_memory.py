"""Steps and methods in a process that may take hardly more memory: an error or the result, and the process lives on.

``python test_little_memory.py steps`` (or ``methods``) runs each in a few MiB of room after the other, and prints what came
of it. What ends the process, or is an exception other than of memory, fails.
"""

import inspect
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from every_step import steps_of

import cgroup
from cgroup import features, registration, verification
from cgroup.datasets import make_problem

ROOMS = {"steps": (1, 4, 16, 60, 250), "methods": (1, 4, 15)}
"""MiB beyond what the process has."""

OPTIONS = {
    "gtm": {"iterations": 3}, "gc": {"variant": "clique", "iterations": 200}, "ransac": {"iterations": 200},
    "st": {"min_distance_ratio": 0.99}, "mac": {"max_cliques": 1000}, "teaser": {"max_steps": 1000},
}  # fmt: skip
"""With which methods need no time to speak of where there is memory."""

POINTS = 40_000
THREADS = 2


def surface() -> tuple[np.ndarray, np.ndarray]:
    """Points of a golden-angle lattice on a bumpy sphere, about 1 apart, and their directions."""
    i = np.arange(POINTS)
    z = 1 - (2 * i + 1) / POINTS
    angle, flat = i * np.pi * (1 + 5**0.5), np.sqrt(1 - z * z)
    directions = np.c_[flat * np.cos(angle), flat * np.sin(angle), z]
    x, y, z = directions.T
    bumps = 1 + 0.1 * np.sin(5 * x + y) + 0.05 * np.sin(11 * z)
    return directions * (np.sqrt(POINTS / 4 / np.pi) * bumps)[:, None], directions


def steps() -> dict[str, Callable[[], object]]:
    """What is run."""
    points, normals = surface()
    rng = np.random.default_rng(0)
    rows = np.arange(0, POINTS, 20)
    faces = rng.integers(0, POINTS, (POINTS, 3))
    table = rng.normal(size=(3_000, 100))
    frames = np.tile(np.eye(3), (POINTS, 1, 1))
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, 0, 3] = np.arange(20)
    few = slice(0, POINTS, 20)
    fields = {"ratio": np.full(POINTS, 0.5), "source_lrf": frames, "target_lrf": frames, "resolution": 1.0}

    def verify() -> object:
        built = verification.Surface(points, normals, unit=0.4)
        return verification.verify(built, built, poses, threads=THREADS)

    def describe() -> object:
        return registration.describe(points[few], resolution=4.5, threads=THREADS)

    return {
        **steps_of(points, normals, unit=1.0, rows=rows, faces=faces, threads=THREADS),
        "fpfh of every point": lambda: features.fpfh(points, normals, radius=2.5, threads=THREADS),
        "describe": describe,
        "match": lambda: features.match(table, table, k=50, threads=THREADS),
        "verify": verify,
        "register": lambda: registration.register(points[few], points[few], threads=THREADS),
        "si": lambda: cgroup.si(points, points, **fields, neighbors=20, threads=THREADS),
    }


def methods() -> dict[str, Callable[[], object]]:
    """Every method, with any bound on its matrix lifted."""
    matches = make_problem(np.random.default_rng(0), 6000, inlier_ratio=0.02).correspondences()

    def call(name: str) -> Callable[[], object]:
        takes_bound = "max_memory" in inspect.signature(cgroup.METHODS[name]).parameters
        options = {**OPTIONS.get(name, {}), **({"max_memory": 10**12} if takes_bound else {})}
        return lambda: cgroup.group(matches, name, threads=THREADS, **options)

    return {name: call(name) for name in cgroup.METHODS}


def outcome(step: Callable[[], object], room: int) -> str:
    """What comes of a step that may take so many MiB more than the process has."""
    import resource  # noqa: PLC0415 - Windows has none

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + (room << 20), hard))
    try:
        step()
    except MemoryError as error:
        return f"{type(error).__name__} {error}"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    return "result"


def main(which: str) -> None:
    # Threads are started while there is room for them; so is NumPy's linear algebra, which ends the process without.
    np.linalg.det(np.eye(500) @ np.eye(500))
    features.match(np.eye(300), np.eye(300), threads=THREADS)
    features.mesh_normals(np.eye(3), [[0, 1, 2]])
    for name, step in {"steps": steps, "methods": methods}[which]().items():
        for room in ROOMS[which]:
            sys.stdout.write(f"{name} in {room} MiB: ")
            sys.stdout.flush()
            sys.stdout.write(f"{outcome(step, room)}\n")
            sys.stdout.flush()


AT_ONCE = {"MALLOC_MMAP_THRESHOLD_": "65536", "MALLOC_ARENA_MAX": "1"}
"""Has glibc give blocks back to the system at once, so that what one step had is no room for the next."""


@pytest.mark.skipif(sys.platform != "linux", reason="address space is limited and told so on Linux only")
@pytest.mark.parametrize("which", ["steps", "methods"])
def test_too_little_memory_is_an_error(which: str):
    done = subprocess.run(
        [sys.executable, "-W", "ignore", __file__, which],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env={**os.environ, **AT_ONCE},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    outcomes = [line.partition(": ")[2] for line in done.stdout.splitlines()]
    refused = [outcome for outcome in outcomes if outcome.startswith("OutOfMemoryError")]
    assert 0 < len(refused) < len(outcomes), done.stdout
    assert all("no memory for a block of" in outcome for outcome in refused), refused


if __name__ == "__main__":
    main(sys.argv[1])
