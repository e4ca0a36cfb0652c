"""The command line as a program: its streams closed or full, Ctrl-C at any moment, strange names of files."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import command_lines
import pytest

import cgroup

if TYPE_CHECKING:
    from collections.abc import Sequence

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="streams, names and signals are Unix's")

FULL = Path("/dev/full")
NAMES = {
    b"red \x1b[31m.txt": r"red \x1b[31m",
    b"two\nlines.txt": r"two\nlines",
    b"latin \xff.txt": r"latin \udcff",
    b"z" * 200 + b".txt": "z" * 200,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("input")
    command_lines.write_inputs(path)
    return path


def run(
    *arguments: str | bytes | Path,
    cwd: Path,
    module: str = "cgroup",
    out: int | IO[bytes] = subprocess.PIPE,
    err: int | IO[bytes] = subprocess.PIPE,
    **environment: str,
) -> tuple[int, str, str]:
    """Run the program, or a module in its place; return its exit status and what it printed."""
    command: Sequence[Any] = [sys.executable, "-m", module, *arguments]
    environment = {**os.environ, **environment}
    done = subprocess.run(command, cwd=cwd, stdout=out, stderr=err, env=environment, check=False)
    return done.returncode, *(
        (text or b"").decode("utf-8", "surrogateescape") for text in (done.stdout, done.stderr)
    )


def test_the_module_is_the_program(tmp_path: Path) -> None:
    assert run("--version", cwd=tmp_path) == (0, f"cgroup {cgroup.__version__}\n", "")


# --- standard output and error -------------------------------------------------------------------


@pytest.mark.parametrize("line", ["--help", "group matches.npz"])
def test_a_reader_that_goes_ends_the_program_without_a_word(folder: Path, line: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "wb") as pipe:
        assert run(*line.split(), cwd=folder, out=pipe) == (141, "", "")


@pytest.mark.skipif(not FULL.exists(), reason="no /dev/full here")
@pytest.mark.parametrize("line", ["--help", "group matches.npz"])
def test_a_full_disk_is_one_line_and_status_2(folder: Path, line: str) -> None:
    says = "cgroup: standard output: can't be written (No space left on device)\n"
    with FULL.open("wb") as full:
        assert run(*line.split(), cwd=folder, out=full) == (2, "", says)
        assert run(*line.split(), cwd=folder, out=full, err=full) == (2, "", "")


@pytest.mark.parametrize(("file", "status"), [("matches.npz", 0), ("missing.npz", 2)])
@pytest.mark.parametrize("closed", [">&-", ">&- 2>&-"])
def test_closed_streams_change_no_exit_status(folder: Path, file: str, status: int, closed: str) -> None:
    script = f'exec "$0" -m cgroup group {file} {closed}'
    assert subprocess.run(["sh", "-c", script, sys.executable], cwd=folder, check=False).returncode == status
    assert (folder / "out/matches_lc_mask.txt").exists() or status


def test_what_the_output_cannot_encode_is_escaped(folder: Path) -> None:
    (folder / "größe.npz").write_bytes((folder / "matches.npz").read_bytes())
    status, out, err = run("group", "größe.npz", cwd=folder, LC_ALL="C", PYTHONIOENCODING="ascii")
    assert (status, err) == (0, "")
    assert r"gr\xf6\xdfe_lc_mask.txt" in out


# --- names ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES, ids=range(len(NAMES)))
def test_control_characters_in_names_are_shown_escaped(
    folder: Path, name: bytes, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    try:
        (folder / os.fsdecode(name)).write_bytes((folder / "matches.txt").read_bytes())
    except OSError as error:
        pytest.skip(f"no such names here: {error}")
    status, out, err = run("group", name, "--method", "gtm", cwd=folder, COLUMNS="1000")
    assert (status, err) == (0, "")
    stem = f"{NAMES[name]}_gtm_"
    assert out.endswith(f"\nwrote {stem}mask.txt, {stem}transform.txt, {stem}residuals.txt to out/\n")
    monkeypatch.chdir(folder)
    err = command_lines.fail(capsys, "group", "no " + os.fsdecode(name))
    assert err == f"cgroup: no {NAMES[name]}.txt: no such file\n"


def test_names_in_figures_are_no_formulas(folder: Path) -> None:
    name = "a$\\frac$[b]\x1b.ply"
    (folder / name).write_bytes((folder / "source.ply").read_bytes())
    status, out, err = run("detect", name, cwd=folder)
    assert (status, err) == (0, "")
    assert out.startswith("cloud       a$\\frac$[b]\\x1b.ply: ")


# --- the folder for results ----------------------------------------------------------------------

WRITING = (
    "detect {}",
    "describe {}",
    "register {} {}",
    "merge {} {}",
    "locate {} --map {}",
    "compare {} {} --truth {}",
    "recognize {} --scene {}",
    "group {}",
    "demo",
    "benchmark run smoke",
)


@pytest.mark.parametrize("line", WRITING)
@pytest.mark.parametrize("out", ["cloud.ply/below", "/proc/nowhere/out", "/proc"])
def test_where_results_go_is_looked_at_before_work_starts(
    capsys: pytest.CaptureFixture[str], elsewhere: Path, line: str, out: str
) -> None:
    """The input isn't even there; and nothing can be made in /proc by those who may do anything either."""
    (elsewhere / "cloud.ply").touch()
    err = command_lines.fail(capsys, *line.format(*3 * ["missing.ply"]).split(), "--out", out)
    assert err.startswith(f"cgroup: {out}: ")


# --- Ctrl-C --------------------------------------------------------------------------------------

INTERRUPTS = int(os.environ.get("CGROUP_INTERRUPTS", "3"))


@pytest.mark.parametrize("moment", range(INTERRUPTS))
def test_an_interrupt_at_any_moment_is_one_line(folder: Path, moment: int) -> None:
    """Whenever it comes after the package has begun to load, and until the program's end."""
    program = [sys.executable, "-X", "importtime", "-m", "cgroup", "demo", "--out", folder / "demo"]
    running = subprocess.Popen(program, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=folder)
    assert running.stderr is not None
    while not (loaded := running.stderr.readline()).endswith(b"cgroup._runtime.interrupts\n"):
        assert loaded, "the program has ended"
    running.stderr.readline()  # of the import that follows
    time.sleep(random.Random(moment).uniform(0, 1.5))
    running.send_signal(signal.SIGINT)
    said = [
        line
        for line in running.communicate(timeout=60)[1].splitlines()
        if not line.startswith(b"import time:")
    ]
    assert (running.returncode, said) in [(130, [b"cgroup: interrupted"]), (0, [])]


IN_COMPILED_MODULE = """
import signal, sys
from importlib.machinery import ExtensionFileLoader

def interrupt(frame, *_):
    is_called_by_module = not frame.f_code.co_filename.startswith("<frozen importlib")
    while is_called_by_module and frame is not None:
        if frame.f_code is ExtensionFileLoader.exec_module.__code__ and "ft2font" in str(frame.f_locals):
            sys.setprofile(None)
            signal.raise_signal(signal.SIGINT)
            return
        frame = frame.f_back

sys.setprofile(interrupt)
"""

IN_COMPILED_CALL = """
import signal, sys

def stop(frame, *_):
    if frame.f_code.co_name == "standin_pair":
        sys.setprofile(None)
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise ValueError("Invalid matrix") from None

sys.setprofile(stop)
"""

IN_CALLBACK = """
import signal, sys

class Callback:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

def interrupt(frame, *_):
    if frame.f_code.co_name == "standin_pair":
        sys.setprofile(None)
        Callback()

sys.setprofile(interrupt)
"""

AFTER_THE_LAST_LINE = """
import signal, sys

class Last:
    def __del__(self, interrupt=signal.raise_signal, number=signal.SIGINT):
        interrupt(number)

sys.last = Last()
"""


def run_interrupted(*arguments: str, how: str, folder: Path) -> tuple[int, str]:
    (folder / "sitecustomize.py").write_text(how)
    path = os.pathsep.join([str(folder), *filter(None, [os.environ.get("PYTHONPATH")])])
    status, _, err = run(*arguments, cwd=folder, PYTHONPATH=path)
    return status, err


@pytest.mark.parametrize(
    "how",
    [IN_COMPILED_MODULE, IN_COMPILED_CALL, IN_CALLBACK],
    ids=["compiled module", "compiled call", "callback"],
)
def test_an_interrupt_that_others_would_hide_is_one(folder: Path, how: str) -> None:
    """matplotlib's modules would make an `ImportError` of it and abort the process, its functions make a
    `ValueError` of it, and Python's callbacks print it.
    """
    assert run_interrupted("demo", "--out", "demo", how=how, folder=folder) == (130, "cgroup: interrupted\n")


def test_an_interrupt_changes_nothing_of_a_command_that_is_done(folder: Path) -> None:
    assert run_interrupted("--version", how=AFTER_THE_LAST_LINE, folder=folder) == (0, "")


# --- whatever nobody foresaw ---------------------------------------------------------------------

BROKEN = """
import sys
from cgroup import cli
from cgroup.cli.commands import group

def fail(*_, **__):
    raise {error}

group.group = fail
cli.main(["group", "matches.npz"])
"""


@pytest.mark.parametrize(
    ("error", "status", "says"),
    [
        ("ZeroDivisionError('a\\nb')", 70, "unexpected ZeroDivisionError (a b); this is a bug in cgroup: "),
        ("MemoryError()", 2, "not enough memory"),
        ("ImportError('x.so: failed to map segment')", 2, "not enough memory (x.so: failed"),
        ("OSError(5, 'Input/output error', 'disk')", 2, "disk: Input/output error"),
        ("KeyboardInterrupt()", 130, "interrupted"),
        ("exec('raise KeyboardInterrupt')", 130, "interrupted"),  # as in the making of a named tuple
    ],
)
def test_whatever_goes_wrong_is_one_line(folder: Path, error: str, status: int, says: str) -> None:
    (folder / "broken.py").write_text(BROKEN.format(error=error))
    # As a module, as which the command line is run: what Python makes of an interrupt depends on it.
    ended, out, err = run(cwd=folder, module="broken")
    assert (ended, out) == (status, "")
    assert err.startswith(f"cgroup: {says}")
    assert err.count("\n") == 1


def test_the_traceback_can_be_asked_for(folder: Path) -> None:
    (folder / "broken.py").write_text(BROKEN.format(error="ZeroDivisionError"))
    status, _, err = run(cwd=folder, module="broken", CGROUP_TRACEBACK="1")
    assert status == 70
    assert err.startswith("Traceback (most recent call last):")
