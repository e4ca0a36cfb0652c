"""The benchmark's processes: whoever is killed, whenever, none stays behind and no record is lost."""

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil
import pytest

from benchmark_runs import (
    GATED,
    MATCHES,
    Gate,
    cgroup_benchmark,
    contents,
    is_sound,
    serial,
    start_benchmark,
    wait_until,
)
from cgroup.benchmark import tables
from cgroup.benchmark.results import KILLED
from cgroup.benchmark.store import RECORDS

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals are sent differently there")

THOROUGH = os.environ.get("HYPOTHESIS_PROFILE") == "thorough"
KILLS = 120 if THOROUGH else 10
SLOW = MATCHES.replace('"ransac", "gtm"', '"ransac", "benchmark_fakes:slow"')


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def find_pids(log: Path, word: str) -> set[int]:
    return {int(line.split()[1]) for line in log.read_text().splitlines() if line.startswith(word)}


def is_alive(pid: int) -> bool:
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False


def find_processes(folder: Path) -> list[int]:
    """Processes that were started with this log, of whatever parent."""
    log, found = str(folder / "calls.log"), []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            if process.pid != os.getpid() and process.environ().get("FAKES_LOG") == log:
                found.append(process.pid)
    return [pid for pid in found if is_alive(pid)]


def wait_for_end_of_all(folder: Path) -> None:
    wait_until(lambda: not find_processes(folder), "some process stays behind")


linux_only = pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="needs /proc")


@linux_only
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_workers_end_with_the_run_even_while_they_compute(how, tmp_path, log):
    config = write(tmp_path / "t.toml", MATCHES.replace('"ransac", "gtm"', '"benchmark_fakes:busy"'))
    run = start_benchmark("run", config, "--out", tmp_path / "out", "--workers", 2, FAKES_HOLD="busy")
    wait_until(lambda: len(find_pids(log, "busy")) == 2, "no two workers")
    os.kill(run.pid, how)
    out, err = run.communicate(timeout=30)
    wait_for_end_of_all(tmp_path)
    if how == signal.SIGKILL:
        assert (run.returncode, out, err) == (-how, "", "")
    else:
        assert run.returncode == 128 + how
        assert "run the same command again to continue" in out
        assert err == ("cgroup: interrupted\n" if how == signal.SIGINT else "")
    assert is_sound(tmp_path / "out")
    assert serial(config.read_text(), tmp_path / "out").counts["experiment"] == (8, 0, 8)


@linux_only
def test_what_a_worker_has_started_ends_with_it(tmp_path, log):
    config = write(tmp_path / "t.toml", MATCHES.replace('"ransac", "gtm"', '"benchmark_fakes:parent"'))
    run = start_benchmark("run", config, "--out", tmp_path / "out", "--workers", 1)
    wait_until(lambda: find_pids(log, "child"), "no child")
    run.kill()
    run.communicate()
    wait_for_end_of_all(tmp_path)


def test_a_run_in_the_background_stays_deaf_to_ctrl_c(tmp_path, log):
    config = write(tmp_path / "t.toml", SLOW)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        run = start_benchmark("run", config, "--out", tmp_path / "out", "--workers", 2)
    finally:
        signal.signal(signal.SIGINT, before)
    wait_until(lambda: find_pids(log, "slow"), "no worker")
    os.killpg(run.pid, signal.SIGINT)
    _, err = run.communicate(timeout=60)
    assert (run.returncode, err) == (0, "")


@linux_only
def test_killed_at_random_the_records_are_those_of_an_undisturbed_run(tmp_path, log):
    """Kills the run or one of its workers at any moment, and continues, again and again.

    A task whose workers were killed three times in a row counts as failed, and is tried again.
    """
    rng = np.random.default_rng(0)
    config = write(tmp_path / "t.toml", SLOW)
    serial(SLOW, tmp_path / "whole")
    expected = contents(tmp_path / "whole")
    kills, finished = {"run": 0, "worker": 0}, 0
    out = tmp_path / "0"
    while sum(kills.values()) < KILLS:
        log.write_text("")
        run = start_benchmark("run", config, "--out", out, "--workers", 2, "--retry-failed")
        killed = _disturb(run, log, rng, kills)
        wait_for_end_of_all(tmp_path)
        if (out / RECORDS).exists() and (out / RECORDS).stat().st_size:
            assert is_sound(out)
        if not killed and set(tables.load(out)["error"]) == {""}:
            assert contents(out) == expected
            finished += 1
            out = tmp_path / str(finished)
    serial(SLOW, out, retry_failed=True)
    assert contents(out) == expected
    assert min(kills.values())
    sys.stdout.write(f"{kills}, {finished + 1} runs came to their end\n")  # shown by pytest -s


def _disturb(run: subprocess.Popen[str], log: Path, rng: np.random.Generator, kills: dict[str, int]) -> bool:
    """Kill workers of a run, one after the other, and perhaps the run itself; return whether it was killed."""
    started = time.monotonic()
    doomed_after = rng.uniform(0.2, 3) if rng.random() < 0.7 else np.inf
    next_worker = 0.0
    while run.poll() is None:
        passed = time.monotonic() - started
        if passed > doomed_after:
            run.kill()
            kills["run"] += 1
            break
        workers = [pid for pid in find_pids(log, "slow") if is_alive(pid)]
        if workers and passed > next_worker:
            with suppress(ProcessLookupError):
                os.kill(int(rng.choice(workers)), signal.SIGKILL)
                kills["worker"] += 1
            next_worker = passed + rng.uniform(0.1, 1)
        time.sleep(0.01)
    _, err = run.communicate()
    assert err == ""
    assert run.returncode in {0, -signal.SIGKILL}
    return run.returncode != 0


def test_a_worker_killed_from_outside_is_not_blamed_on_its_task(tmp_path, log):
    config = write(tmp_path / "t.toml", SLOW)
    run = start_benchmark("run", config, "--out", tmp_path / "out", "--workers", 2)
    wait_until(lambda: find_pids(log, "slow"), "no worker")
    os.kill(find_pids(log, "slow").pop(), signal.SIGKILL)
    out, err = run.communicate(timeout=60)
    assert (run.returncode, err) == (0, "")
    assert "failed" not in out
    assert KILLED not in set(tables.load(tmp_path / "out")["error"])


@pytest.fixture
def gate(tmp_path: Path, log: Path) -> Gate:  # noqa: ARG001 - the gate reads it
    return Gate(tmp_path)


def test_two_runs_at_once_and_readers_beside_them(tmp_path, gate, monkeypatch):
    config = write(tmp_path / "t.toml", GATED)
    out = tmp_path / "out"
    run = start_benchmark("run", config, "--out", out, "--workers", 2, **gate.environment)
    gate.wait_for(1)
    status, printed, err = cgroup_benchmark("run", config, "--out", out)
    assert (status, printed, err.count("\n")) == (2, "", 1)
    assert "another run is using it" in err
    seen = 0
    for calls in range(6):
        gate.open_for(1)
        gate.wait_for(calls + 2)
        frame = tables.load(out)
        assert len(frame) >= seen
        assert is_sound(out)
        seen = len(frame)
    shutil.copytree(out, tmp_path / "copy")  # in the midst of the run
    gate.open_for(100)
    _, err = run.communicate(timeout=60)
    assert (run.returncode, err) == (0, "")
    monkeypatch.setenv("FAKES_GATE", gate.environment["FAKES_GATE"])
    gate.open_for(100)
    serial(GATED, tmp_path / "copy")
    assert contents(tmp_path / "copy") == contents(out)
    assert is_sound(tmp_path / "copy")
