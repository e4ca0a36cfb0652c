"""Steps and methods in a process that may take hardly more memory: an error or the result, and the process lives on."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("little_memory.py")

AT_ONCE = {"MALLOC_MMAP_THRESHOLD_": "65536", "MALLOC_ARENA_MAX": "1"}
"""Has glibc give blocks back to the system at once, so that what one step had is no room for the next."""


@pytest.mark.skipif(sys.platform != "linux", reason="address space is limited and told so on Linux only")
@pytest.mark.parametrize("which", ["steps", "methods"])
def test_too_little_memory_is_an_error(which: str):
    done = subprocess.run(
        [sys.executable, "-W", "ignore", str(PROGRAM), which],
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
