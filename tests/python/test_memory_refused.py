"""Methods in a process that the system gives little memory: an error or a group, and the interpreter goes on."""

import os
import subprocess
import sys

import pytest

import cgroup

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs a limit of address space")

PROGRAM = """
import inspect, resource, sys
import numpy as np
import cgroup
from cgroup.datasets import make_problem

OPTIONS = {
    "gtm": {"iterations": 3}, "gc": {"variant": "clique", "iterations": 200}, "ransac": {"iterations": 200},
    "st": {"min_distance_ratio": 0.99}, "mac": {"max_cliques": 1000}, "teaser": {"max_steps": 1000},
}

def limit(room):
    used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + room, resource.RLIM_INFINITY))

def outcome(method, matches):
    try:
        takes_bound = "max_memory" in inspect.signature(cgroup.METHODS[method]).parameters
        bound = {"max_memory": 10**12} if takes_bound else {}
        cgroup.group(matches, method, threads=2, **bound, **OPTIONS.get(method, {}))
    except cgroup.OutOfMemoryError as error:
        assert "no memory for a block of" in str(error)
        return "refused"
    except MemoryError:
        return "refused outside the core"
    return "group"

drawn = make_problem(np.random.default_rng(0), 6000, inlier_ratio=0.02)
names = ["source", "target", "similarity", "ratio", "source_lrf", "target_lrf", "resolution"]
matches = cgroup.Correspondences(**{name: getattr(drawn, name) for name in names})
cgroup.ransac(drawn.source[:9], drawn.target[:9], tolerance=1.0, threads=2)  # starts the threads
for name in sys.argv[2:]:
    limit(int(sys.argv[1]) << 20)
    print(name, outcome(name, matches), flush=True)
print("the interpreter goes on")
"""


def outcomes(room: int, methods: list[str]) -> dict[str, str]:
    """Run methods in a process that may take so many MiB more than it has."""
    command = [sys.executable, "-c", PROGRAM, str(room), *methods]
    # Each further arena of the C library takes 64 MiB of addresses, of which the room would then be a part.
    environment = os.environ | {"MALLOC_ARENA_MAX": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300, env=environment)
    assert done.returncode == 0, f"ended after {done.stdout}\n{done.stderr}"
    *lines, last = done.stdout.splitlines()
    assert last == "the interpreter goes on"
    return dict(line.split(" ", 1) for line in lines)


@pytest.mark.parametrize("room", [1, 4, 15])
def test_no_method_ends_the_interpreter(room):
    found = outcomes(room, sorted(cgroup.METHODS))
    assert found.keys() == cgroup.METHODS.keys()
    assert "refused" in found.values()
