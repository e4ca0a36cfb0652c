"""Changed files in a process of little memory."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("cloud_mutations.py")


@pytest.mark.skipif(sys.platform != "linux", reason="memory is bounded through /proc and setrlimit")
def test_changed_files_end_in_a_cloud_or_an_error() -> None:
    done = subprocess.run(
        [sys.executable, str(PROGRAM), "8", "4000", "256"],
        capture_output=True,
        text=True,
        check=False,
        timeout=600,
    )
    tally = re.fullmatch(r"read=(\d+) refused=(\d+) wrong=0\n", done.stdout)
    assert tally, done.stdout[-4000:] + done.stderr[-4000:]
    # Changes that are all refused at the first line would test little.
    assert min(int(count) for count in tally.groups()) > 400
