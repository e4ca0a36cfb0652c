"""Ctrl-C, sent to a program once it computes."""

import os
import signal
import subprocess
import sys

import pytest

posix_only = pytest.mark.skipif(sys.platform == "win32", reason="no such signals there")


def interrupt(program: str, *, after: str) -> str:
    """Run a program, send Ctrl-C once it has printed the line `after`, and return what it prints from then on."""
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, env=os.environ
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line == after + "\n":
                break
        process.send_signal(signal.SIGINT)
        printed = process.stdout.read()
        assert process.wait() == 0
    return printed
