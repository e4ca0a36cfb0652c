"""What happens to processes: Ctrl-C, sent to a program once it computes, and a fork."""

import os
import select
import signal
import subprocess
import sys
import textwrap
from collections.abc import Callable

import pytest

COMPUTING = """
import os, sys, threading
{preparation}
begun = threading.Event()
threading.Thread(target=lambda: begun.wait() and os.write(1, b"computing\\n"), daemon=True).start()
sys.setswitchinterval(1000)  # the other thread gets its turn once the computation lets go
try:
    begun.set()
    {call}
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""

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


def assert_hears_interrupt(preparation: str, call: str) -> None:
    """Send Ctrl-C to a call that would compute for long, once it computes beside other threads."""
    program = COMPUTING.format(preparation=textwrap.dedent(preparation), call=call)
    assert interrupt(program, after="computing") == "interrupted\n"


def assert_holds_in_a_fork(check: Callable[[], bool]) -> None:
    """Fork this process, which has computed before, and ask its child; one that hangs is killed after a minute."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os._exit(0 if check() else 1)
    os.close(writer)
    ended, _, _ = select.select([reader], [], [], 60)  # its end of the pipe closes with it
    os.close(reader)
    if not ended:
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    assert ended, "the forked process hangs"
    assert os.waitstatus_to_exitcode(status) == 0
