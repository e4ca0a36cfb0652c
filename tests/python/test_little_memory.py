"""Steps and methods in a process that may take hardly more memory: an error or the result, and the process lives on.

As a program, it runs ``steps`` or ``methods`` one after the other, registers in 5 MiB with ``register 5``, or asks for
too many ``threads``, and prints the outcomes.
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

    return {
        **steps_of(points, normals, unit=1.0, rows=rows, faces=faces, threads=THREADS),
        "fpfh of every point": lambda: features.fpfh(points, normals, radius=2.5, threads=THREADS),
        "describe": lambda: registration.describe(points[few], resolution=4.5, threads=THREADS),
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
    # Threads are started while there is room for them.
    features.match(np.eye(300), np.eye(300), threads=THREADS)
    features.mesh_normals(np.eye(3), [[0, 1, 2]])
    for name, step in {"steps": steps, "methods": methods}[which]().items():
        for room in ROOMS[which]:
            print(f"{name} in {room} MiB: ", end="", flush=True)  # noqa: T201 - even where that ends the process
            print(outcome(step, room), flush=True)  # noqa: T201


def register_within(room: int | None) -> str:
    """What comes of `register` as the first thing after the import; without a limit, the MiB that it takes."""
    points = surface()[0][::20]

    def register() -> object:
        return registration.register(points, points, threads=THREADS)

    if room is not None:
        return outcome(register, room)
    used = memory_of_process()["VmSize"]
    register()
    return str((memory_of_process()["VmPeak"] - used) >> 10)


def memory_of_process() -> dict[str, int]:
    """Return the sizes of this process's memory by name, in KiB."""
    lines = (line.split() for line in Path("/proc/self/status").read_text().splitlines())
    return {words[0].rstrip(":"): int(words[1]) for words in lines if words[-1] == "kB"}


MANY = 64
"""Threads, whose stacks take more than there is."""


def start_many_threads() -> None:
    """Ask for more threads than there is room for."""
    matches = make_problem(np.random.default_rng(0), 100).correspondences()
    for step in (
        lambda: cgroup.group(matches, "gc", threads=MANY),
        lambda: cgroup.group_many([matches] * MANY, "gc", threads=MANY),
    ):
        sys.stdout.write(f"threads: {outcome(step, 40)}\n")


AT_ONCE = {"MALLOC_MMAP_THRESHOLD_": "65536", "MALLOC_ARENA_MAX": "1"}
"""Has glibc give blocks back to the system at once, so that what one step had is no room for the next."""

linux_only = pytest.mark.skipif(sys.platform != "linux", reason="address space is limited on Linux only")


def outcomes_of(*which: str) -> list[str]:
    """What the program prints, without the names of the steps."""
    done = subprocess.run(
        [sys.executable, "-W", "ignore", __file__, *which],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env={**os.environ, **AT_ONCE, "OPENBLAS_NUM_THREADS": "2"},  # with one it takes its buffer early
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return [line.partition(": ")[2] for line in done.stdout.splitlines()]


@linux_only
@pytest.mark.parametrize("which", ["steps", "methods"])
def test_too_little_memory_is_an_error(which: str):
    outcomes = outcomes_of(which)
    refused = [outcome for outcome in outcomes if outcome.startswith("OutOfMemoryError")]
    assert 0 < len(refused) < len(outcomes), outcomes
    assert all("no memory" in outcome for outcome in refused), refused


@linux_only
def test_registering_in_too_little_memory_is_an_error_or_succeeds():
    [needed] = outcomes_of("register")
    rooms = [int(needed) * part // 5 for part in range(5)]
    outcomes = [outcome for room in rooms for outcome in outcomes_of("register", str(room))]
    refused = [outcome for outcome in outcomes if outcome != "result"]
    assert refused
    assert all(outcome.startswith("OutOfMemoryError ") for outcome in refused), refused
    assert all("allow the process more" in outcome for outcome in refused), refused


@linux_only
def test_too_few_threads_are_an_error_that_says_what_to_do():
    core, python = outcomes_of("threads")
    for outcome, remedy in ((core, "give threads=1"), (python, "give fewer threads")):
        assert outcome.startswith(f"OutOfMemoryError the system does not start {MANY} threads ("), outcome
        assert outcome.endswith(f"; {remedy}, or allow the process more threads or more memory")


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["register", *room]:
            sys.stdout.write(f"register: {register_within(int(room[0]) if room else None)}\n")
        case ["threads"]:
            start_many_threads()
        case [which]:
            main(which)
