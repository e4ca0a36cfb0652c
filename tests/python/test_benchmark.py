"""The benchmark's runner: nothing lost, nothing done twice, the same records however it is run."""

import os
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import benchmark_fakes
from benchmark_runs import CLOUDS, MATCHES, contents, count, serial, start_benchmark, wait_until
from cgroup.benchmark import run as runner
from cgroup.benchmark import solving, tables
from cgroup.benchmark.config import parse_config
from cgroup.benchmark.results import KILLED
from cgroup.benchmark.run import run
from cgroup.errors import InputError

HERE = Path(__file__).parent


def lines(log: Path) -> list[str]:
    return log.read_text().splitlines()


def test_a_finished_run_computes_nothing_more(tmp_path, log):
    text = CLOUDS.replace('"ss", "gc"', '"ss", "benchmark_fakes:first"')
    serial(text, tmp_path / "out")
    before = contents(tmp_path / "out")
    assert sorted(line for line in lines(log) if line.startswith("noise")) == sorted(
        f"noise {pair} {level}" for pair in "ab" for level in (0.1, 0.2)
    )
    assert lines(log).count("first 20") == 4
    assert sorted(line for line in lines(log) if line.startswith("load")) == ["load a", "load b"]
    log.write_text("")
    serial(text, tmp_path / "out")
    assert lines(log) == []
    assert contents(tmp_path / "out") == before


def test_matches_are_stored_and_further_methods_and_thresholds_use_them(tmp_path, log):
    text = CLOUDS.replace('"ss", "gc"', '"benchmark_fakes:first"')
    serial(text, tmp_path / "out")
    log.write_text("")
    serial(text + "epsilons = [2, 9]", tmp_path / "out")
    assert lines(log) == ["first 20"] * 4
    assert set(tables.load(tmp_path / "out")["epsilon"]) == {2, 9}
    log.write_text("")
    serial(text, tmp_path / "out")
    assert lines(log) == [], "earlier thresholds are kept"
    serial(text.replace('"benchmark_fakes:first"', '"benchmark_fakes:first", "gc"'), tmp_path / "out")
    assert lines(log) == []
    assert set(tables.load(tmp_path / "out")["method"]) == {"benchmark_fakes:first", "gc"}
    serial(text.replace("levels = [0.1, 0.2]", "levels = [0.1, 0.3]"), tmp_path / "out")
    assert lines(log).count("noise a 0.3") == 1
    assert not any("0.1" in line for line in lines(log))
    assert set(tables.load(tmp_path / "out")["level"]) == {0.1, 0.3}


def test_experiments_share_cases(tmp_path, log):
    other = CLOUDS.partition("[[experiment]]")[2].replace('"noise"', '"again"', 1)
    serial(f"{CLOUDS}\n[[experiment]]{other}\nepsilons = [1, 5]", tmp_path / "out")
    assert len([line for line in lines(log) if line.startswith("noise")]) == 4
    frame = tables.load(tmp_path / "out")
    assert set(frame[frame["epsilon"] == 5]["experiments"]) == {("noise", "again")}
    assert set(frame[frame["epsilon"] == 1]["experiments"]) == {("again",)}


def test_a_failed_pair_or_method_is_recorded_and_stops_nothing(tmp_path):
    text = CLOUDS.replace('["a", "b"]', '["a", "broken"]').replace('"gc"', '"benchmark_fakes:failing"')
    summary = serial(text, tmp_path)
    assert summary.counts["experiment"] == (4, 4, 8)
    frame = tables.load(tmp_path)
    broken = frame[frame["pair"] == "broken"]
    assert len(broken) == 4
    assert set(broken["error"]) == {"OSError: this pair is broken"}
    assert broken["precision"].isna().all()
    assert not broken["registered"].any()
    good = frame[(frame["pair"] == "a") & (frame["method"] == "ss")]
    assert len(good) == 2
    assert set(good["error"]) == {""}
    assert tables.aggregate(frame, ["pair"])["pair"].tolist() == ["a"]


def test_failures_are_tried_again_on_demand_only(tmp_path, log):
    text = CLOUDS.replace('["a", "b"]', '["a", "broken"]')
    serial(text, tmp_path / "out")
    log.write_text("")
    serial(text, tmp_path / "out")
    assert lines(log) == []
    summary = serial(text, tmp_path / "out", retry_failed=True)
    assert set(lines(log)) == {"load broken"}
    assert summary.failed == 4


def test_a_method_that_kills_its_process_costs_only_itself(tmp_path, log):
    text = MATCHES.replace('"ransac", "gtm"', '"benchmark_fakes:first", "benchmark_fakes:deadly", "gtm"')
    summary = run(parse_config(text), tmp_path, workers=2)
    corners = {
        f"m{i}": benchmark_fakes.Matches().load(f"m{i}").correspondences.source[0, 0] for i in range(8)
    }
    deadly = {("benchmark_fakes:deadly", name) for name, corner in corners.items() if corner > 90}
    assert 0 < len(deadly) < 8
    errors = tables.load(tmp_path).set_index(["method", "pair"])["error"]
    assert errors[errors != ""].to_dict() == dict.fromkeys(deadly, KILLED)
    assert summary.counts["experiment"] == (24 - len(deadly), len(deadly), 24)
    log.write_text("")
    run(parse_config(text), tmp_path, workers=2, retry_failed=True)
    assert "first 20" not in lines(log), "only what failed is tried again"


def test_a_method_that_hangs_is_ended_and_costs_only_itself(tmp_path, monkeypatch):
    text = MATCHES.replace('"ransac", "gtm"', '"gtm", "benchmark_fakes:endless"') + "pairs = 3\nlimit = 2"
    summary = run(parse_config(text), tmp_path, workers=1)
    assert summary.counts["experiment"] == (3, 3, 6)
    frame = tables.load(tmp_path).set_index("method")
    assert set(frame.loc["gtm"]["error"]) == {""}
    assert sorted(frame.loc["benchmark_fakes:endless"]["error"]) == [
        "OutOfTime: not run: took longer than 2 s on 60 matches",
        *["OutOfTime: took longer than 2 s"] * 2,
    ]
    monkeypatch.setenv("FAKES_END", "1")
    more = text.replace("limit = 2", "limit = 60")
    assert run(parse_config(more), tmp_path, workers=1).failed == 3, "nothing is tried again unasked"
    assert run(parse_config(more), tmp_path, workers=1, retry_failed=True).failed == 0


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[object, ...]]:
    out = tmp_path_factory.mktemp("serial")
    serial(MATCHES, out)
    return contents(out)


@pytest.mark.parametrize(("backend", "workers"), [("processes", 2), ("threading", 3)])
def test_records_do_not_depend_on_the_backend(backend, workers, expected, tmp_path):
    run(parse_config(MATCHES), tmp_path, backend=backend, workers=workers)
    assert contents(tmp_path) == expected


@pytest.mark.skipif(os.name == "nt", reason="there is no kill -9")
def test_killed_and_started_again_nothing_is_lost_or_done_twice(tmp_path, log):
    config = tmp_path / "tiny.toml"
    config.write_text(MATCHES.replace('"ransac", "gtm"', '"ransac", "benchmark_fakes:first"'))
    serial(config.read_text(), tmp_path / "whole")
    # It stays in the midst of the stage, and so can't end before it is killed.
    slow = start_benchmark("run", config, "--out", tmp_path / "out", "--workers", 2, FAKES_HOLD="first")
    wait_until(lambda: count(tmp_path / "out", "results") >= 3, "no 3 results")
    os.killpg(slow.pid, signal.SIGKILL)
    slow.communicate()
    stored = count(tmp_path / "out", "results")
    assert 3 <= stored < 16
    log.write_text("")
    again = start_benchmark("run", config, "--out", tmp_path / "out", "--workers", 2)
    _, err = again.communicate(timeout=60)
    assert (again.returncode, err) == (0, "")
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    assert len([line for line in lines(log) if line.startswith("first")]) == 8 - stored // 2


@pytest.mark.skipif(os.name == "nt", reason="interrupts are sent differently there")
@pytest.mark.usefixtures("log")
def test_interrupt_keeps_what_is_finished(tmp_path):
    config = tmp_path / "tiny.toml"
    config.write_text(MATCHES)
    slow = start_benchmark("run", config, "--out", tmp_path / "out", "--workers", 2, FAKES_HOLD="load")
    wait_until(lambda: count(tmp_path / "out", "matches") >= 2, "no 2 problems")
    os.killpg(slow.pid, signal.SIGINT)
    out, err = slow.communicate(timeout=30)
    assert (slow.returncode, err) == (130, "cgroup: interrupted\n")
    assert "run the same command again to continue" in out
    serial(MATCHES, tmp_path / "out")
    assert len(tables.load(tmp_path / "out")) == 16


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"backend": "ray"}, "backend: got 'ray'; choose one of processes, dask, threading"),
        ({"backend": "dask"}, "scheduler: needed by the dask backend"),
        ({"backend": "slurm"}, "backend: got 'slurm'; choose one of processes"),
        ({"workers": 0}, "workers: got 0"),
    ],
)
def test_backends_that_are_not_there(options, says, tmp_path, monkeypatch):
    monkeypatch.delenv("DASK_SCHEDULER_ADDRESS", raising=False)
    with pytest.raises(InputError, match=says):
        run(parse_config(MATCHES), tmp_path, **options)  # pyright: ignore[reportArgumentType]


TIMING = """
[timing]
dataset = ["benchmark_fakes:Absent", "benchmark_fakes:Clouds"]
sizes = [30, 60]
repeats = 2
threads = 1
methods = ["gc", "benchmark_fakes:first", "benchmark_fakes:wrong_length"]
"""


class Here:
    """A worker whose process is this one, where it can be watched."""

    def __init__(self, _threads: int, cores: int = 0) -> None:
        pass

    def call(self, function: Callable[..., Any], *arguments: object, limit: float = 1.0) -> Any:
        assert limit > 0
        return function(*arguments)

    def close(self) -> None:
        pass


def test_times_are_taken_once(tmp_path, log, monkeypatch):
    monkeypatch.setattr(runner.engine, "Worker", Here)
    monkeypatch.setattr(solving, "SHORTEST", 1e-9)
    text = MATCHES + "pairs = 1" + TIMING
    serial(text, tmp_path / "out")
    times = tables.load(tmp_path / "out", "timing")
    assert len(times) == 2 * 2 * 2  # sizes, methods, repeats
    assert times["seconds"].min() > 0
    assert len(set(times["n"])) == 2
    assert lines(log).count("first 20") == 2 * 3  # and one to warm up
    skips = tables.load_skips(tmp_path / "out")
    assert set(skips["method"]) == {"benchmark_fakes:wrong_length"}
    log.write_text("")
    serial(text, tmp_path / "out")
    assert lines(log) == []
    assert tables.load(tmp_path / "out", "timing").equals(times)


def test_what_would_take_too_long_is_skipped_with_a_reason(tmp_path, monkeypatch):
    monkeypatch.setattr(runner.engine, "Worker", Here)
    monkeypatch.setattr(solving, "measure", lambda _call, repeats: [6.0] * repeats)
    serial(MATCHES + "pairs = 1" + TIMING + "budget = 7", tmp_path)
    times = tables.load(tmp_path, "timing")
    assert len(set(times["n"])) == 1
    skips = tables.load_skips(tmp_path)
    reasons = skips[skips["method"] == "gc"]["reason"].tolist()
    assert len(reasons) == 1
    assert "s per call, more than 7 s" in reasons[0]


def test_what_kills_or_hangs_its_process_has_no_times(tmp_path):
    text = TIMING.replace("[30, 60]", "[30]").replace('"benchmark_fakes:first", ', "")
    text = text.replace("wrong_length", 'fatal", "benchmark_fakes:endless", "benchmark_fakes:failing')
    serial(MATCHES + "pairs = 1" + text + "budget = 1", tmp_path)
    assert set(tables.load(tmp_path, "timing")["method"]) >= {"gc"}
    reasons = tables.load_skips(tmp_path).set_index("method")["reason"].to_dict()
    assert reasons["benchmark_fakes:fatal"] == KILLED
    assert reasons["benchmark_fakes:endless"] == "took longer than 1 s per call"


def test_exponents_are_fitted_to_the_large_sets():
    n = np.array([500, 2000, 4000, 8000])
    rows = [
        {"method": method, "n": size, "threads": threads, "seconds": 1e-6 * size**power * scale}
        for method, power in (("gc", 2), ("nnsr", 1))
        for size in n
        for threads in (1, 0)
        for scale in ((1.0, 1.0, 99.0) if size > 500 else (1e6,))
    ]
    fitted = tables.exponents(pd.DataFrame(rows))
    assert fitted["method"].tolist() == ["gc", "nnsr"]
    np.testing.assert_allclose(fitted["exponent"], [2, 1])
    assert fitted["sizes"].tolist() == [3, 3]
    assert np.isnan(solving.fit_exponent([100, 100], [1, 2]))
