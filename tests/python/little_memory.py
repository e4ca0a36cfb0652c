"""Runs every step in a few MiB of room after the other, and prints what came of it: a result or a MemoryError.

What ends the process, or is another exception, fails.
"""

import resource
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

import cgroup
from cgroup import features, registration, verification

ROOMS = (1, 4, 16, 60, 250)
"""MiB beyond what the process has."""

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

    def verify() -> object:
        built = verification.Surface(points, normals, unit=0.4)
        return verification.verify(built, built, poses, threads=THREADS)

    def describe() -> object:
        return registration.describe(points[few], resolution=4.5, threads=THREADS)

    return {
        "normals": lambda: features.normals(points, threads=THREADS),
        "mesh normals": lambda: features.mesh_normals(points, faces),
        "voxels": lambda: features.voxel_downsample(points, 0.5, threads=THREADS),
        "iss": lambda: features.iss(points, resolution=1.0, threads=THREADS),
        "shot": lambda: features.shot(points, normals, rows, radius=4.0, threads=THREADS),
        "fpfh": lambda: features.fpfh(points, normals, radius=2.5, threads=THREADS),
        "describe": describe,
        "match": lambda: features.match(table, table, k=50, threads=THREADS),
        "verify": verify,
        "register": lambda: registration.register(points[few], points[few], threads=THREADS),
        "si": lambda: cgroup.si(
            points,
            points,
            ratio=np.full(POINTS, 0.5),
            source_lrf=frames,
            target_lrf=frames,
            resolution=1.0,
            neighbors=20,
            threads=THREADS,
        ),
    }


def used() -> int:
    """Bytes of address space."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def main() -> None:
    # Threads are started while there is room for them; so is NumPy's linear algebra, which ends the process without.
    np.linalg.det(np.eye(500) @ np.eye(500))
    features.match(np.eye(300), np.eye(300), threads=THREADS)
    features.mesh_normals(np.eye(3), [[0, 1, 2]])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    for name, step in steps().items():
        for room in ROOMS:
            sys.stdout.write(f"{name} in {room} MiB: ")
            sys.stdout.flush()
            resource.setrlimit(resource.RLIMIT_AS, (used() + (room << 20), hard))
            try:
                step()
                outcome = "result"
            except MemoryError:
                outcome = "MemoryError"
            finally:
                resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
            sys.stdout.write(f"{outcome}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
