"""Arrays that another process writes to while they are read: each call ends, in a result or an error of the package."""

import subprocess
import sys
from pathlib import Path

PROGRAM = Path(__file__).with_name("changing_input.py")

SECONDS = 6
"""How long the calls go on: a race is won now and then only."""

PATIENCE = 120
"""Seconds after which a call counts as one that finds no end."""


def test_every_call_ends():
    command = [sys.executable, "-W", "ignore", str(PROGRAM), str(SECONDS)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stderr
    results, errors = map(int, done.stdout.split())
    assert results > 0, "no call got through"
    assert errors > 0, "nothing was spoilt: the test is void"
