"""The benchmark on a Dask cluster, the workers and scheduler of which may be lost."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from dask_clusters import Cluster, make_cluster

import benchmark_fakes
from benchmark_runs import (
    GATED,
    MATCHES,
    Gate,
    contents,
    finish,
    is_sound,
    serial,
    start_benchmark,
)
from cgroup.benchmark import tables
from cgroup.benchmark.config import parse_config
from cgroup.benchmark.results import KILLED
from cgroup.benchmark.run import run
from cgroup.errors import InputError

KILLS = 40 if os.environ.get("HYPOTHESIS_PROFILE") == "thorough" else 1


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[object, ...]]:
    out = tmp_path_factory.mktemp("serial")
    serial(MATCHES, out)
    return contents(out)


@pytest.fixture
def cluster(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Cluster]:
    """Three workers and a scheduler; the parameter is how many lost workers a task may have been on."""
    yield from make_cluster(tmp_path, getattr(request, "param", 3))


@pytest.mark.skipif(os.name == "nt", reason="there is no kill -9")
def test_a_dask_cluster_that_loses_a_worker(tmp_path, monkeypatch, request):
    gate = Gate(tmp_path)
    for name, value in gate.environment.items():
        monkeypatch.setenv(name, value)
    address, workers = request.getfixturevalue("cluster")
    config = tmp_path / "t.toml"
    config.write_text(GATED)
    wait = ["--backend", "dask", "--scheduler", address]
    started = start_benchmark("run", config, "--out", tmp_path / "out", *wait, PYTHONFAULTHANDLER="1")
    gate.wait_for(2)  # calls that two of the workers are at
    workers[0].kill()
    workers[0].wait()
    gate.open_for(100)
    assert finish(started)[::2] == (0, "")
    serial(GATED, tmp_path / "whole")
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


@pytest.mark.filterwarnings("default")
@pytest.mark.parametrize("cluster", [0], indirect=True)
def test_a_task_that_kills_dask_workers_is_recorded(cluster, tmp_path):
    text = MATCHES.replace('"ransac"', '"benchmark_fakes:deadly"') + 'pairs = ["m0", "m4"]'
    assert benchmark_fakes.Matches().load("m4").correspondences.source[0, 0] > 90
    run(parse_config(text), tmp_path / "out", backend="dask", scheduler=cluster[0])
    errors = tables.load(tmp_path / "out").set_index(["method", "pair"])["error"]
    assert errors[errors != ""].to_dict() == {("benchmark_fakes:deadly", "m4"): KILLED}
    assert len(errors) == 4


@pytest.mark.filterwarnings("default")
def test_a_lost_scheduler_is_one_line_and_the_run_goes_on_later(cluster, expected, tmp_path):
    address, (*_, scheduler) = cluster

    def kill_scheduler(stage: str, done: int, _wanted: int) -> None:
        if stage == "match" and done >= 2:
            scheduler.kill()
            scheduler.wait()

    dask = pytest.importorskip("dask")
    lost = pytest.raises(InputError, match="scheduler: the connection is lost .*; run the same command again")
    with dask.config.set({"distributed.comm.timeouts.connect": "1s"}), lost:
        run(parse_config(MATCHES), tmp_path, backend="dask", scheduler=address, progress=kill_scheduler)
    serial(MATCHES, tmp_path)
    assert contents(tmp_path) == expected


def test_the_command_line_says_in_one_line_that_the_scheduler_is_lost(tmp_path, monkeypatch):
    """Kills the scheduler after 0 to 8 of the 8 calls; what is there continues on this machine."""
    rng = np.random.default_rng(0)
    config = tmp_path / "t.toml"
    config.write_text(GATED)
    for number in range(KILLS):
        out, passed = tmp_path / str(number), number % 9
        out.mkdir()
        gate = Gate(out)
        for name, value in gate.environment.items():
            monkeypatch.setenv(name, value)
        gate.open_for(passed)
        for address, (*_, scheduler) in make_cluster(out, 3):
            wait = ["--backend", "dask", "--scheduler", address]
            started = start_benchmark("run", config, "--out", out, *wait)
            gate.wait_for(min(passed + 1, 8))
            time.sleep(rng.uniform(0, 0.5))
            scheduler.kill()
            status, printed, err = finish(started)
        if passed < 8 or status != 0:
            assert (status, printed, err.count("\n")) == (2, "", 1), err
            assert err.startswith("cgroup: --scheduler: the connection is lost (")
        else:
            assert err == ""
        assert is_sound(out)
        gate.open_for(100)
        serial(GATED, out)
        serial(GATED, tmp_path / "whole")
        assert contents(out) == contents(tmp_path / "whole")
