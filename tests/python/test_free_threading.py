"""Many threads at once, on interpreters without a global lock above all: same results, no lock, no harm."""

import subprocess
import sys
import sysconfig
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from cgroup import Correspondences, group
from cgroup.datasets import make_problem, standin_pair
from cgroup.features import Cloud, harris3d, normals
from cgroup.registry import METHOD_INFO
from cgroup.verification import Surface, score_poses

THREADS = 8
CALLS = 32


def run_at_once(call):
    """Results of CALLS calls by THREADS threads that start together."""
    barrier = threading.Barrier(THREADS)
    started = threading.local()

    def wait_then_call(_):
        if not hasattr(started, "here"):
            started.here = True
            barrier.wait(timeout=60)
        return call()

    with ThreadPoolExecutor(THREADS) as pool:
        return list(pool.map(wait_then_call, range(CALLS)))


@pytest.mark.skipif(not sysconfig.get_config_var("Py_GIL_DISABLED"), reason="this Python has a global lock")
def test_the_lock_stays_off():
    script = "import sys, cgroup, cgroup.registration; print(sys._is_gil_enabled())"
    printed = subprocess.check_output([sys.executable, "-W", "error", "-c", script], text=True)
    assert printed == "False\n"


@pytest.fixture(scope="module")
def matches() -> Correspondences:
    return make_problem(np.random.default_rng(3), 300, inlier_ratio=0.4).correspondences()


@pytest.mark.parametrize("name", METHOD_INFO)
def test_methods_side_by_side(name: str, matches: Correspondences):
    alone = group(matches, name, threads=1)
    for together in run_at_once(lambda: group(matches, name, threads=2)):
        assert np.array_equal(together.mask, alone.mask)
        assert np.array_equal(together.transform(), alone.transform())


def test_one_cloud_for_all_threads():
    points = standin_pair(pixels=60).source.points
    alone, cloud = harris3d(points), Cloud(points)  # its tree is built when it is first looked into
    for together in run_at_once(lambda: harris3d(cloud)):
        assert np.array_equal(together, alone)


def test_one_surface_for_all_threads():
    points = standin_pair(pixels=60).source.points
    directions = normals(points, neighbors=10)
    alone = score_poses(*[Surface(points, directions, unit=1.0)] * 2, np.eye(4))
    surface = Surface(points, directions, unit=1.0)  # its cells are filled when they are first looked into
    for together in run_at_once(lambda: score_poses(surface, surface, np.eye(4))):
        assert np.array_equal(together, alone)
