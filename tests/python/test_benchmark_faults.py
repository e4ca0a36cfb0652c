"""The benchmark's records on disks that fail: one line, nothing lost, and the next run goes on."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmark_runs import MATCHES, contents, serial
from cgroup.cli import main

HERE = Path(__file__).parent
STEP = 1 if os.environ.get("HYPOTHESIS_PROFILE") == "thorough" else 40


@pytest.fixture(scope="module")
def failing_disk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the library that makes system calls fail."""
    compiler = shutil.which("cc")
    if not sys.platform.startswith("linux") or compiler is None:
        pytest.skip("needs Linux and a C compiler, to preload a library that makes system calls fail")
    library = tmp_path_factory.mktemp("disk") / "failing_disk.so"
    source = HERE / "failing_disk.c"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, source, "-ldl"], check=True)
    return library


def test_a_disk_that_fails_at_any_write_loses_nothing(failing_disk, tmp_path):
    config = tmp_path / "tiny.toml"
    config.write_text(MATCHES.replace('"ransac", "gtm"', '"ransac"') + "pairs = 2")
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, HERE / "disk_faults.py", config, tmp_path, str(STEP)],
        env={**os.environ, "LD_PRELOAD": str(failing_disk), "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    outcomes = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(outcomes) > 4 * 40 / STEP
    failed = [outcome for outcome in outcomes if outcome["status"]]
    assert len(failed) > len(outcomes) / 2  # what fails at the very end, SQLite makes good later
    for outcome in failed:
        assert outcome["status"] == 2
        assert outcome["errors"].startswith("cgroup: OUT")
        assert outcome["errors"].count("\n") == 1
    for outcome in outcomes:
        assert outcome["again"] == [0, ""]
        assert outcome["same"]


@pytest.fixture
def read_only(tmp_path: Path) -> Iterator[Path]:
    """A folder with records that can't be written to, not even by root."""
    out = tmp_path / "out"
    serial(MATCHES + "pairs = 2", out)
    if os.name != "posix":
        pytest.skip("needs POSIX permissions")
    if os.geteuid():
        out.chmod(0o500)
        yield out
        out.chmod(0o700)
        return
    for before, after in (
        (["mount", "--bind", "-o", "ro", out, out], ["umount", out]),
        (["chattr", "+i", out], ["chattr", "-i", out]),
    ):
        if (
            shutil.which(str(before[0]))
            and not subprocess.run(before, capture_output=True, check=False).returncode
        ):
            try:
                yield out
            finally:
                subprocess.run(after, check=True)
            return
    pytest.skip("root may write everywhere here: neither a read-only mount nor chattr works")


def command(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["benchmark", *map(str, arguments)])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


def test_a_folder_that_is_read_only(read_only, tmp_path, capsys):
    config = tmp_path / "tiny.toml"
    config.write_text(MATCHES + "pairs = 3")
    before = contents(shutil.copytree(read_only, tmp_path / "copy"))
    for arguments in (("run", config), ("report",)):
        status, out, err = command(capsys, *arguments, "--out", read_only)
        assert (status, out, err.count("\n")) == (2, "", 1)
        assert "can't be" in err
    for name in ("status", "claims"):
        status, out, err = command(capsys, name, "--out", read_only)
        assert (status, err) == (0, "")
    status, out, err = command(capsys, "run", config, "--out", tmp_path / "copy", "--backend", "threading")
    assert (status, err) == (0, "")
    assert {row for row in before if row[0] == "results"} < set(contents(tmp_path / "copy"))


def test_a_folder_that_cannot_be_made(tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    status, _, err = command(capsys, "run", "smoke", "--out", tmp_path / "file" / "out")
    assert (status, err.count("\n")) == (2, 1)
    assert "can't be made a folder" in err
