"""Arrays that another process writes to while they are read: each call ends, in a result or an error of the package.

``python test_changing_input.py SECONDS`` calls every method and step, and prints how many calls returned something and how
many raised an error of the package. Any other exception ends it.
"""

import inspect
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from every_step import steps_of

from cgroup import features, verification
from cgroup.datasets import make_problem
from cgroup.errors import CgroupError
from cgroup.registry import METHOD_INFO
from cgroup.types import FloatArray, IndexArray

WRITER = """
import os, sys, time
import numpy as np

path, parent = sys.argv[1], int(sys.argv[2])
shared = np.memmap(path, np.float64, "r+")
good = np.array(shared)
rng = np.random.default_rng(0)
bad = (np.nan, np.inf, 0.0, -1e300, 1e150, 1e-200, 0.5, np.int64(7).view(np.float64), np.int64(-1).view(np.float64))
print("ready", flush=True)
while os.getppid() == parent:
    step = int(10 ** rng.uniform(2, 6))
    part = slice(rng.integers(step), None, step)
    value, right = bad[rng.integers(len(bad))], np.array(good[part])
    for _ in range(rng.integers(200)):
        shared[part] = value
        shared[part] = right
    time.sleep(1e-3)
"""
"""Spoils parts of the file for a moment, as long as its parent lives."""

MATCHES, POINTS, KEYPOINTS = 700, 4_000, 400


class Shared:
    """A file of float64 that arrays are put into, one behind the other."""

    def __init__(self, folder: str) -> None:
        self.path = Path(folder) / "shared"
        self._memory = np.memmap(self.path, np.float64, "w+", shape=1_000_000)
        self._used = 0

    def put(self, array: FloatArray | IndexArray) -> FloatArray | IndexArray:
        place = self._memory[self._used : self._used + array.size]
        self._used += array.size
        view = np.asarray(place).view(array.dtype).reshape(array.shape)
        view[...] = array
        return view


def calls(shared: Shared) -> Iterator[Callable[[], object]]:
    """Every method and step, each on shared arrays."""
    problem = make_problem(np.random.default_rng(3), MATCHES)
    names = ("source", "target", "similarity", "ratio", "source_lrf", "target_lrf")
    fields = {name: shared.put(getattr(problem, name)) for name in names} | {"resolution": problem.resolution}
    for info in METHOD_INFO.values():  # not through `Correspondences`, which copies
        taken = {*info.fields, "resolution"} & {*fields} & {*inspect.signature(info.function).parameters}
        yield partial(info.function, **{name: fields[name] for name in taken})

    rng = np.random.default_rng(5)
    directions = rng.normal(size=(POINTS, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    points = shared.put(directions * (20 + 2 * np.sin(5 * directions[:, :1])))
    normals = shared.put(directions)
    rows = shared.put(np.arange(KEYPOINTS, dtype=np.int64))
    faces = shared.put(rng.integers(0, POINTS, (2 * POINTS, 3)))
    frames = shared.put(np.tile(np.eye(3), (KEYPOINTS, 1, 1)))
    table = shared.put(rng.normal(size=(KEYPOINTS, 33)))
    poses = shared.put(np.tile(np.eye(4), (50, 1, 1)))
    yield from steps_of(points, normals, unit=1.0, rows=rows, faces=faces).values()
    yield partial(features.shot, points, normals, rows, radius=4.0, lrf=frames)
    yield partial(features.match, table, table, k=3, mutual=True)
    yield partial(verification.Surface, points, normals, unit=0.5)
    whole = verification.Surface(np.array(points), np.array(normals), unit=0.5)
    yield partial(verification.verify, whole, whole, poses)
    fine = verification.FineSurface(np.array(points), spacing=1.0)
    yield partial(verification.align, fine, fine, poses[0])


def ends_in_a_result(call: Callable[[], object]) -> bool:
    """Whether the call returns something; otherwise it raises an error of the package."""
    try:
        call()
    except CgroupError:
        return False
    return True


def main(seconds: float) -> None:
    """Call everything again and again for so long, and on until both a result and an error came of it."""
    outcomes: list[bool] = []
    with tempfile.TemporaryDirectory() as folder:
        shared = Shared(folder)
        todo = list(calls(shared))
        command = [sys.executable, "-c", WRITER, str(shared.path), str(os.getpid())]
        with subprocess.Popen(command, stdout=subprocess.PIPE) as writer:
            assert writer.stdout is not None
            writer.stdout.readline()
            end = time.monotonic() + seconds
            while time.monotonic() < end or len(set(outcomes)) < 2:
                outcomes += map(ends_in_a_result, todo)
            writer.kill()
    sys.stdout.write(f"{outcomes.count(True)} {outcomes.count(False)}\n")


SECONDS = 3
"""How long the calls go on: a race is won now and then only."""

PATIENCE = 120
"""Seconds after which a call counts as one that finds no end."""


def test_every_call_ends():
    command = [sys.executable, "-W", "ignore", __file__, str(SECONDS)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stderr
    assert all(map(int, done.stdout.split()))


if __name__ == "__main__":
    main(float(sys.argv[1]))
