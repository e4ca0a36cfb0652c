"""The benchmark's runner: nothing lost, nothing done twice, the same records however it is run."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

import benchmark_fakes
import numpy as np
import pandas as pd
import pytest

from cgroup import group
from cgroup.benchmark import records, scoring, stages, timing
from cgroup.benchmark.candidates import candidate
from cgroup.benchmark.cases import Case
from cgroup.benchmark.chained import gc_then_ransac, gtm_then_ransac
from cgroup.benchmark.config import Config, parse_config, preset_names, read_config
from cgroup.benchmark.packing import pack, unpack
from cgroup.benchmark.plan import make_plan
from cgroup.benchmark.run import Summary, run
from cgroup.benchmark.store import RECORDS, Store, only_writer
from cgroup.cli import main
from cgroup.datasets import standin_pair
from cgroup.errors import InputError, NoConsensusError
from cgroup.evaluation import rotation_error, score_group, translation_error
from cgroup.registration import correspond

if TYPE_CHECKING:
    from collections.abc import Iterator

    from cgroup.benchmark.results import Scored

HERE = Path(__file__).parent

MATCHES = """
name = "tiny"
methods = ["ransac", "gtm"]
[[experiment]]
id = "bare"
dataset = "benchmark_fakes:Matches"
"""

CLOUDS = """
name = "tiny"
methods = ["ss", "gc"]
[[experiment]]
id = "noise"
dataset = "benchmark_fakes:Clouds"
nuisance = "benchmark_fakes:noise"
levels = [0.1, 0.2]
pairs = ["a", "b"]
"""


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "calls.log"
    path.touch()
    monkeypatch.setenv("FAKES_LOG", str(path))
    return path


def lines(log: Path) -> list[str]:
    return log.read_text().splitlines()


def serial(text: str, out: Path, **options: object) -> Summary:
    return run(parse_config(text), out, workers=1, **options)  # pyright: ignore[reportArgumentType]


def contents(out: Path) -> list[tuple[object, ...]]:
    """Everything that a run computed, apart from times, versions and machines."""
    store = Store(out / RECORDS)
    tables = {
        "correspondences": "case_key, n, pr, facts, parameters, error",
        "arrays": "case_key, content, truth, sample",
        "groupings": "case_key, method_key, mask, threshold, pose, diagnostics, parameters, error",
        "scores": "*",
        "plan_cases": "*",
    }
    rows = [
        (table, *row)
        for table, columns in tables.items()
        for row in store.connection.execute(f"select {columns} from {table}")
    ]
    store.close()
    return sorted(rows, key=repr)


# --- configuration -------------------------------------------------------------------------------

WRONG = [
    ('experiment = [{id = "x", dataset = "b3r", epsilons = [-1]}]', "experiment[0].epsilons[0]: Input"),
    ('experiment = [{id = "x"}]', "experiment[0].dataset: Field required"),
    ('experiment = [{id = "x", dataset = "b3r", levles = [1]}]', "experiment[0].levles: Extra"),
    ('experiment = [{id = "x", dataset = "b3r", levels = [1]}]', "experiment[0]: levels: needed with"),
    ('experiment = [{id = "x", dataset = "b3r", nuisance = "noise"}]', "experiment[0]: levels: needed with"),
    (
        'experiment = [{id = "x", dataset = "b3r", combinations = ["C7"]}]',
        "experiment[0]: combinations: got 'C7'; choose from C1",
    ),
    (
        'experiment = [{id = "x", dataset = "b3r", sweep = "nms_radius", nuisance = "noise", levels = [1]}]',
        "experiment[0]: nuisance, sweep: the levels can belong to one of them only",
    ),
    ('methods = ["icp"]\nexperiment = [{id = "x", dataset = "b3r"}]', "methods[0]: method: got 'icp'"),
    (
        'methods = [{name = "gtm", options = {iteration = 5}}]\nexperiment = [{id = "x", dataset = "b3r"}]',
        "methods[0]: option: gtm has no 'iteration'; it takes iterations",
    ),
    (
        'methods = ["benchmark_fakes:missing"]\nexperiment = [{id = "x", dataset = "b3r"}]',
        "methods[0]: method: module 'benchmark_fakes' has no 'missing'",
    ),
    (
        'methods = ["gtm", {name = "gtm", options = {one_to_one = true}}]\nexperiment = [{id = "x", dataset = "b3r"}]',
        "methods: two are called 'gtm'; give each variant a label",
    ),
    ('seed = "much"\nexperiment = [{id = "x", dataset = "b3r"}]', "seed: Input should be a valid integer"),
    ("experiment = [", "not TOML"),
]


@pytest.mark.parametrize(("text", "says"), WRONG, ids=[says for _, says in WRONG])
def test_wrong_configuration_is_one_line_with_the_keys_path(text: str, says: str) -> None:
    with pytest.raises(InputError) as raised:
        parse_config(f'name = "x"\n{text}', "x.toml")
    assert str(raised.value).startswith(f"x.toml: {says}")
    assert "\n" not in str(raised.value)


def test_presets_can_be_read() -> None:
    assert {"smoke", "paper-small", "paper"} <= set(preset_names())
    ids = ["noise", "density", "clutter", "occlusion", "overlap", "epsilon", "matches", "combinations"]
    for name in preset_names():
        preset = read_config(name)
        assert preset.name == name
        assert set(ids) <= {entry.id for entry in preset.experiment}
        assert preset.timing is not None
    with pytest.raises(InputError, match="no configuration that can be read, nor one of paper"):
        read_config("nowhere.toml")


def test_a_small_draw_of_pairs_is_part_of_a_larger_one() -> None:
    text = MATCHES + "pairs = {}"
    drawn = [
        {case.pair for case in make_plan(parse_config(text.replace("{}", n)), None).experiments[0].cases}
        for n in ("2", "5", "100")
    ]
    assert [len(pairs) for pairs in drawn] == [2, 5, 8]
    assert drawn[0] < drawn[1] < drawn[2]


def test_absent_data_is_left_out_and_named(tmp_path: Path) -> None:
    both = MATCHES.replace(
        '"benchmark_fakes:Matches"', '["benchmark_fakes:Matches", "benchmark_fakes:Absent"]'
    )
    summary = serial(both + "pairs = 2", tmp_path)
    assert summary.missing == {"benchmark_fakes:Absent": "absent: get it from nowhere"}
    assert records.load_missing(tmp_path) == summary.missing
    assert summary.counts["correspond"].done == 2
    with pytest.raises(InputError, match="none of the data sets is at hand.*get it from nowhere"):
        serial(MATCHES.replace("Matches", "Absent"), tmp_path)


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ('pairs = ["m0", "m99"]', "bare: benchmark_fakes:Matches has no pair 'm99'; the first is 'm0'"),
        ('nuisance = "noise"\nlevels = [1]', "takes no nuisance and no sweep"),
    ],
)
def test_what_the_data_set_does_not_have(more: str, says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=says):
        serial(MATCHES + more, tmp_path)


def test_keys_and_random_numbers_are_the_same_everywhere() -> None:
    case = Case("b3r", "scene0", "noise", 0.05, "C1", None, 3)
    assert case.key == "e3adb31a82c311d944385598"
    assert case.rng("nuisance").integers(1 << 30) == 1056362948
    assert case.rng("nuisance").random() == case.rng("nuisance").random()
    assert case.rng("nuisance").random() != case.rng("sample").random()


# --- records -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def clouds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("clouds")
    serial(CLOUDS + "epsilons = [1, 5]", out)
    return out


def test_records_say_what_the_methods_did(clouds: Path) -> None:
    frame = records.load(clouds)
    assert len(frame) == 2 * 2 * 2 * 2  # pairs, levels, methods, thresholds
    assert set(frame["experiments"]) == {("noise",)}
    for row in frame.itertuples():
        case = Case("benchmark_fakes:Clouds", str(row.pair), str(row.nuisance), float(row.level))
        pair = benchmark_fakes.Clouds().load(case.pair)
        pair = benchmark_fakes.noise(pair, float(row.level), case.rng("nuisance"))
        matches = correspond(pair.source, pair.target)
        pr = matches.resolution
        assert pr is not None
        grouping = group(matches, str(row.method))
        misses = np.linalg.norm(matches.source - matches.target + [1, 2, 3], axis=1)
        score = score_group(grouping.mask, misses <= float(row.epsilon) * pr)
        assert (row.n, row.correct, row.selected) == (score.matches, score.correct, score.selected)
        assert (row.precision, row.recall) == (score.precision, score.recall)
        assert (row.f_score, row.registered) == (score.f_score, score.registered)
        try:
            pose = grouping.transform()
        except NoConsensusError:
            assert np.isnan(row.rotation_error)
            continue
        assert row.rotation_error == pytest.approx(rotation_error(pose, pair.T_target_source))
        expected = translation_error(pose, pair.T_target_source)
        assert row.translation_error == pytest.approx(expected)
        assert row.translation_error_pr == pytest.approx(expected / pr)


def test_columns(clouds: Path) -> None:
    frame = records.load(clouds)
    assert set(frame.columns) == {
        *("dataset", "origin", "pair", "nuisance", "level", "combination", "detector", "descriptor"),
        *("nms_radius", "clutter", "occlusion", "overlap", "n", "correct", "inlier_ratio", "pr", "method"),
        *("epsilon", "selected", "selected_correct", "precision", "recall", "f_score", "registered"),
        *("rotation_error", "translation_error", "translation_error_pr", "rmse_pr", "seconds"),
        *("experiments", "error", "version", "seed", "machine", "case"),
        *("ok:precision>0.1", "ok:rmse<=5pr"),
    }
    row = frame.iloc[0]
    assert (row["detector"], row["descriptor"], row["overlap"]) == ("h3d", "shot", 0.9)
    assert np.isnan(row["clutter"])
    assert frame["seconds"].min() > 0
    assert (frame["ok:precision>0.1"] == frame["registered"]).all()
    assert records.load_machines(clouds)["id"].tolist() == [row["machine"]]
    assert records.load_config(clouds)["experiment"][0]["levels"] == [0.1, 0.2]
    assert records.load_datasets(clouds)["title"].tolist() == ["Clouds"]


def test_the_overlap_error_is_the_mean_displacement_in_pr() -> None:
    rng = np.random.default_rng(0)
    source = rng.uniform(size=(3000, 3))
    truth, pose = np.eye(4), np.eye(4)
    pose[0, 3] = 0.06
    sample = stages.overlap_sample(source, source[source[:, 0] < 0.5], truth, 0.01, rng)
    assert len(sample) == stages.OVERLAP_SAMPLE
    assert sample[:, 0].max() < 0.5 + 4 * 0.01
    judged = scoring.Truth("", truth, np.zeros(3), sample, 0.01, ("rmse<=5pr", "precision>0.1"))
    [score] = scoring.score_grouping(judged, "", np.packbits([1, 1, 0]).tobytes(), pose.tobytes(), [5])
    assert score.rmse == pytest.approx(6)
    assert json.loads(score.protocols) == {"rmse<=5pr": False, "precision>0.1": True}
    [score] = scoring.score_grouping(judged, "", np.packbits([1, 1, 0]).tobytes(), None, [5])
    assert (score.rmse, score.rotation_error) == (None, None)
    assert json.loads(score.protocols)["rmse<=5pr"] is False


def test_correspondences_survive_packing() -> None:
    pair = standin_pair(pixels=60)
    matches = correspond(pair.source, pair.target)
    packed = pack(matches)
    assert pack(unpack(packed)) == packed
    for method in ("ss", "si", "3dhv", "ransac"):
        one, other = (group(given, method) for given in (matches, unpack(packed)))
        np.testing.assert_array_equal(one.mask, other.mask)


def test_aggregate() -> None:
    frame = pd.DataFrame(
        {
            "method": ["gc", "gc", "gc", "ss"],
            "error": ["", "", "", "OSError: no"],
            "n": [10, 100, 10, np.nan],
            "correct": [5, 10, 0, np.nan],
            "selected": [4, 50, 0, np.nan],
            "selected_correct": [4, 10, 0, np.nan],
            "precision": [1, 0.2, 0, np.nan],
            "recall": [0.8, 1, 0, np.nan],
            "f_score": [8 / 9, 1 / 3, 0, np.nan],
            "inlier_ratio": [0.5, 0.1, 0, np.nan],
            "registered": [True, True, False, False],
            "seconds": [1.0, 2, 3, np.nan],
            "ok:rmse": [True, None, False, None],
        }
    )
    macro, median, pooled = (
        records.aggregate(frame, ["method"], how) for how in ("macro", "median", "pooled")
    )
    assert macro["method"].tolist() == ["gc"]
    assert macro["pairs"][0] == 3
    assert macro["precision"][0] == pytest.approx(0.4)
    assert macro["f_of_means"][0] == pytest.approx(2 * 0.4 * 0.6 / 1.0)
    assert (median["precision"][0], median["recall"][0]) == (0.2, 0.8)
    assert pooled["precision"][0] == pytest.approx(14 / 54)
    assert pooled["recall"][0] == pytest.approx(14 / 15)
    assert pooled["inlier_ratio"][0] == pytest.approx(15 / 120)
    for result in (macro, median, pooled):
        assert result["registered"][0] == pytest.approx(2 / 3)
        assert result["ok:rmse"][0] == pytest.approx(1 / 2)
    with pytest.raises(InputError, match="how: got 'mean'"):
        records.aggregate(frame, ["method"], "mean")  # pyright: ignore[reportArgumentType]


def test_no_records(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no records; make some with"):
        records.load(tmp_path)
    (tmp_path / RECORDS).write_text("something else\n" * 100)
    with pytest.raises(InputError, match="not a file of records"):
        records.load(tmp_path)
    with pytest.raises(InputError, match="can't be used as a store"):
        serial(MATCHES, tmp_path)


# --- methods from outside ------------------------------------------------------------------------


def test_methods_from_outside_get_seed_and_lengths(tmp_path: Path) -> None:
    methods = """
    methods = [
      {name = "benchmark_fakes:first", label = "first 20"},
      {name = "benchmark_fakes:first", label = "first 9", options = {count = 9}},
      {name = "benchmark_fakes:seeded", label = "seeded", options = {reach_pr = 5}},
      {name = "ransac", label = "r", options = {tolerance_pr = 5, iterations = 50}},
      "benchmark_fakes:wrong_length",
    ]
    """
    text = MATCHES.replace('methods = ["ransac", "gtm"]', methods + "\nseed = 7") + "pairs = 3"
    summary = serial(text, tmp_path)
    assert summary.failed == 3
    frame = records.load(tmp_path).set_index(["method", "pair"])
    assert set(frame.loc["first 20"]["precision"]) == {1.0}
    assert set(frame.loc["first 9"]["recall"]) == {9 / 20}
    for pair in set(frame.loc["r"].index):
        assert frame.loc["seeded", pair]["selected"] == frame.loc["r", pair]["selected"]
    [error] = set(frame.loc["benchmark_fakes:wrong_length"]["error"])
    assert "returned bool of shape (3,); return a Grouping or a mask of 60 bool" in error
    store = Store(tmp_path / RECORDS)
    parameters = [json.loads(row[0]) for row in store.connection.execute("select parameters from groupings")]
    store.close()
    assert {"method": "ransac", "options": {"seed": 7, "tolerance": 5, "iterations": 50}} in parameters


def test_ransac_after_another_method_stays_inside_its_group() -> None:
    matches = benchmark_fakes.Matches().load("m0").correspondences
    for method, chained in (("gc", gc_then_ransac), ("gtm", gtm_then_ransac)):
        before = group(matches, method)
        after = candidate("", f"cgroup.benchmark.chained:{chained.__name__}", {}).run(matches)
        assert 3 <= after.size <= before.size
        assert not (after.mask & ~before.mask).any()


# --- nothing twice -------------------------------------------------------------------------------


def test_a_finished_run_computes_nothing_more(tmp_path: Path, log: Path) -> None:
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


def test_each_stage_uses_what_the_ones_before_have_stored(
    tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scored: list[tuple[float, ...]] = []

    def score(*arguments: object) -> list[Scored]:
        scored.append(tuple(arguments[-1]))  # pyright: ignore[reportArgumentType]
        return judge(*arguments)  # pyright: ignore[reportArgumentType]

    judge = scoring.score_grouping
    monkeypatch.setattr(scoring, "score_grouping", score)
    text = CLOUDS.replace('"ss", "gc"', '"benchmark_fakes:first"')
    serial(text, tmp_path / "out")
    assert scored == [(5.0,)] * 4
    log.write_text("")
    scored.clear()
    serial(text + "epsilons = [2, 5, 9]", tmp_path / "out")
    assert lines(log) == []
    assert scored == [(2.0, 9.0)] * 4
    scored.clear()
    serial(text.replace('"benchmark_fakes:first"', '"benchmark_fakes:first", "gc"'), tmp_path / "out")
    assert lines(log) == []
    assert scored == [(5.0,)] * 4
    assert set(records.load(tmp_path / "out")["method"]) == {"benchmark_fakes:first", "gc"}
    serial(text.replace("levels = [0.1, 0.2]", "levels = [0.1, 0.3]"), tmp_path / "out")
    assert lines(log).count("noise a 0.3") == 1
    assert not any("0.1" in line for line in lines(log))
    assert set(records.load(tmp_path / "out")["level"]) == {0.1, 0.3}


def test_experiments_share_cases(tmp_path: Path, log: Path) -> None:
    other = CLOUDS.partition("[[experiment]]")[2].replace('"noise"', '"again"', 1)
    serial(f"{CLOUDS}\n[[experiment]]{other}\nepsilons = [1, 5]", tmp_path / "out")
    assert len([line for line in lines(log) if line.startswith("noise")]) == 4
    frame = records.load(tmp_path / "out")
    assert set(frame[frame["epsilon"] == 5]["experiments"]) == {("noise", "again")}
    assert set(frame[frame["epsilon"] == 1]["experiments"]) == {("again",)}


# --- failures ------------------------------------------------------------------------------------


def test_a_failed_pair_or_method_is_recorded_and_stops_nothing(tmp_path: Path) -> None:
    text = CLOUDS.replace('["a", "b"]', '["a", "broken"]').replace('"gc"', '"benchmark_fakes:failing"')
    summary = serial(text, tmp_path)
    assert summary.counts["correspond"] == (2, 2, 4)
    frame = records.load(tmp_path)
    broken = frame[frame["pair"] == "broken"]
    assert len(broken) == 4
    assert set(broken["error"]) == {"OSError: this pair is broken"}
    assert broken["precision"].isna().all()
    assert not broken["registered"].any()
    good = frame[(frame["pair"] == "a") & (frame["method"] == "ss")]
    assert len(good) == 2
    assert set(good["error"]) == {""}
    assert records.aggregate(frame, ["pair"])["pair"].tolist() == ["a"]


def test_failures_are_tried_again_on_demand_only(tmp_path: Path, log: Path) -> None:
    text = CLOUDS.replace('["a", "b"]', '["a", "broken"]')
    serial(text, tmp_path / "out")
    log.write_text("")
    serial(text, tmp_path / "out")
    assert lines(log) == []
    summary = serial(text, tmp_path / "out", retry_failed=True)
    assert set(lines(log)) == {"load broken"}
    assert summary.failed == 2


def test_a_worker_that_dies_costs_its_task_only(tmp_path: Path) -> None:
    text = MATCHES.replace('"ransac", "gtm"', '"benchmark_fakes:deadly"')
    run(parse_config(text), tmp_path, workers=2)
    frame = records.load(tmp_path).set_index("pair")
    corners = {
        f"m{i}": benchmark_fakes.Matches().load(f"m{i}").correspondences.source[0, 0] for i in range(8)
    }
    deadly = {name for name, corner in corners.items() if corner > 90}
    assert 0 < len(deadly) < 8
    assert set(frame[frame["error"] != ""].index) == deadly
    assert set(frame.loc[sorted(deadly)]["error"]) == {stages.KILLED}


def test_two_runs_keep_out_of_each_others_way(tmp_path: Path) -> None:
    with only_writer(tmp_path), pytest.raises(InputError, match="another run is at work there"):
        serial(MATCHES, tmp_path)
    serial(MATCHES + "pairs = 1", tmp_path)


# --- however it is run ---------------------------------------------------------------------------


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[object, ...]]:
    out = tmp_path_factory.mktemp("serial")
    serial(MATCHES, out)
    return contents(out)


@pytest.mark.parametrize(("backend", "workers"), [("loky", 2), ("threading", 3)])
def test_records_do_not_depend_on_the_backend(
    backend: str, workers: int, expected: list[tuple[object, ...]], tmp_path: Path
) -> None:
    run(parse_config(MATCHES), tmp_path, backend=backend, workers=workers)
    assert contents(tmp_path) == expected


def environment(**more: str) -> dict[str, str]:
    path = os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": path, **more}


def start(config: Path, out: Path, **more: str) -> subprocess.Popen[str]:
    """`cgroup benchmark run` as the leader of a process group."""
    code = "from cgroup.cli import main; main()"
    command = [
        sys.executable,
        "-c",
        code,
        "benchmark",
        "run",
        str(config),
        "--out",
        str(out),
        "--workers",
        "2",
    ]
    return subprocess.Popen(
        command,
        env=environment(**more),
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def wait_for_records(out: Path, table: str, count: int) -> None:
    deadline = time.monotonic() + 30
    while time.monotonic() < deadline:
        try:
            with closing(sqlite3.connect(f"file:{out / RECORDS}?mode=ro", uri=True)) as connection:
                if connection.execute(f"select count(*) from {table}").fetchone()[0] >= count:
                    return
        except sqlite3.OperationalError:  # not there yet
            pass
        time.sleep(0.02)
    pytest.fail(f"no {count} rows in {table}")


@pytest.mark.skipif(os.name == "nt", reason="there is no kill -9")
@pytest.mark.parametrize("table", ["correspondences", "groupings"])
def test_killed_and_started_again_nothing_is_lost_or_done_twice(
    table: str, tmp_path: Path, log: Path
) -> None:
    config = tmp_path / "tiny.toml"
    config.write_text(MATCHES.replace('"ransac", "gtm"', '"ransac", "benchmark_fakes:first"'))
    serial(config.read_text(), tmp_path / "whole")
    log.write_text("")
    slow = start(config, tmp_path / "out", FAKES_SECONDS="0.15")
    wait_for_records(tmp_path / "out", table, 3)
    os.killpg(slow.pid, signal.SIGKILL)
    slow.communicate()
    stored = {
        name: len([row for row in contents(tmp_path / "out") if row[0] == name])
        for name in ("correspondences", "groupings")
    }
    assert 3 <= stored[table] < (8 if table == "correspondences" else 16)
    log.write_text("")
    again = start(config, tmp_path / "out")
    out, err = again.communicate(timeout=60)
    assert (again.returncode, err) == (0, "")
    assert "groupings      16 of 16" in out
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    # What had been stored wasn't computed again.
    assert len([line for line in lines(log) if line.startswith("load")]) == 8 - stored["correspondences"]
    assert len([line for line in lines(log) if line.startswith("first")]) == 8 - stored["groupings"] // 2


@pytest.mark.skipif(os.name == "nt", reason="interrupts are sent differently there")
def test_interrupt_keeps_what_is_finished(tmp_path: Path) -> None:
    config = tmp_path / "tiny.toml"
    config.write_text(MATCHES)
    slow = start(config, tmp_path / "out", FAKES_SECONDS="0.3")
    wait_for_records(tmp_path / "out", "correspondences", 2)
    os.killpg(slow.pid, signal.SIGINT)
    out, err = slow.communicate(timeout=30)
    assert (slow.returncode, err) == (130, "cgroup: interrupted\n")
    assert "run the same command again to continue" in out
    serial(MATCHES, tmp_path / "out")
    assert len(records.load(tmp_path / "out")) == 16


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A Dask scheduler and three worker processes, as on several machines."""
    file = tmp_path / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "dask"]
    common = ["--scheduler-file", str(file), "--no-dashboard"]
    scheduler = subprocess.Popen([*dask, "scheduler", *common, "--port", "0"], **quiet)  # pyright: ignore[reportArgumentType]
    command = [*dask, "worker", *common, "--nthreads", "1", "--no-nanny"]
    slow = environment(FAKES_SECONDS="0.05")
    workers = [subprocess.Popen(command, env=slow, cwd=tmp_path, **quiet) for _ in range(3)]  # pyright: ignore[reportArgumentType]
    try:
        deadline = time.monotonic() + 30
        while not (file.exists() and file.read_text()):
            assert time.monotonic() < deadline
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"], workers
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


@pytest.mark.skipif(os.name == "nt", reason="there is no kill -9")
@pytest.mark.filterwarnings("default")  # Dask's own
def test_a_dask_cluster_that_loses_a_worker(
    cluster: tuple[str, list[subprocess.Popen[bytes]]], expected: list[tuple[object, ...]], tmp_path: Path
) -> None:
    distributed = pytest.importorskip("distributed")
    address, workers = cluster
    with distributed.Client(address, set_as_default=False) as client:
        client.wait_for_workers(3, timeout=30)
    killed: list[int] = []

    def kill_one(stage: str, done: int, _wanted: int) -> None:
        if stage == "correspond" and done >= 2 and not killed:
            killed.append(workers[0].pid)
            os.kill(workers[0].pid, signal.SIGKILL)

    run(parse_config(MATCHES), tmp_path / "out", backend="dask", scheduler=address, progress=kill_one)
    assert killed
    assert workers[0].wait() == -signal.SIGKILL
    assert contents(tmp_path / "out") == expected


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"backend": "ray"}, "backend: ray isn't installed; pip install"),
        ({"backend": "dask"}, "scheduler: needed by the dask backend"),
        ({"backend": "slurm"}, "backend: got 'slurm'; choose one of loky"),
        ({"workers": 0}, "workers: got 0"),
    ],
)
def test_backends_that_are_not_there(
    options: dict[str, object], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DASK_SCHEDULER_ADDRESS", raising=False)
    with pytest.raises(InputError, match=says):
        run(parse_config(MATCHES), tmp_path, **options)  # pyright: ignore[reportArgumentType]


# --- timing --------------------------------------------------------------------------------------

TIMING = """
[timing]
dataset = ["benchmark_fakes:Absent", "benchmark_fakes:Clouds"]
sizes = [30, 60]
repeats = 2
threads = 1
methods = ["gc", "benchmark_fakes:first", "benchmark_fakes:wrong_length"]
"""


def test_times_are_taken_once(tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "SHORTEST", 1e-9)
    text = MATCHES + "pairs = 1" + TIMING
    serial(text, tmp_path / "out")
    times = records.load_timing(tmp_path / "out")
    assert list(times.columns) == [
        *("method", "n", "threads", "repeat", "seconds", "dataset", "pair", "machine", "version")
    ]
    assert len(times) == 2 * 2 * 2  # sizes, methods, repeats
    assert times["seconds"].min() > 0
    assert len(set(times["n"])) == 2
    assert lines(log).count("first 20") == 2 * 3  # and one to warm up
    skips = records.load_timing_skips(tmp_path / "out")
    assert set(skips["method"]) == {"benchmark_fakes:wrong_length"}
    log.write_text("")
    serial(text, tmp_path / "out")
    assert lines(log) == []
    assert records.load_timing(tmp_path / "out").equals(times)


def test_what_would_take_too_long_is_skipped_with_a_reason(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(timing, "measure", lambda _call, repeats: [6.0] * repeats)
    serial(MATCHES + "pairs = 1" + TIMING + "budget = 7", tmp_path)
    times = records.load_timing(tmp_path)
    assert len(set(times["n"])) == 1
    skips = records.load_timing_skips(tmp_path)
    reasons = skips[skips["method"] == "gc"]["reason"].tolist()
    assert len(reasons) == 1
    assert "s per call, more than 7 s" in reasons[0]


def test_exponents_are_fitted_to_the_large_sets() -> None:
    n = np.array([500, 2000, 4000, 8000])
    rows = [
        {"method": method, "n": size, "threads": threads, "seconds": 1e-6 * size**power * scale}
        for method, power in (("gc", 2), ("nnsr", 1))
        for size in n
        for threads in (1, 0)
        for scale in ((1.0, 1.0, 99.0) if size > 500 else (1e6,))
    ]
    fitted = records.exponents(pd.DataFrame(rows))
    assert fitted["method"].tolist() == ["gc", "nnsr"]
    np.testing.assert_allclose(fitted["exponent"], [2, 1])
    assert fitted["sizes"].tolist() == [3, 3]
    assert np.isnan(timing.fit_exponent([100, 100], [1, 2]))


# --- command line --------------------------------------------------------------------------------


def command(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["benchmark", *map(str, arguments)])
    out, err = capsys.readouterr()
    assert isinstance(ended.value.code, int)
    return ended.value.code, out, err


def test_run_and_status(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "own.toml"
    config.write_text(CLOUDS.replace('["a", "b"]', '["a", "broken"]'))
    status, out, err = command(capsys, "run", config, "--out", tmp_path / "out", "--workers", 1)
    assert (status, err) == (0, "")
    assert "cases matched  2 of 4, 2 failed" in out
    assert "2 of 12 failed; see: cgroup benchmark status" in out
    status, out, err = command(capsys, "status", "--out", tmp_path / "out")
    assert (status, err) == (0, "")
    assert "failed     2 x correspond: OSError: this pair is broken" in out


def test_presets(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = command(capsys, "presets")
    assert (status, err) == (0, "")
    for name in preset_names():
        assert name in out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ("run nowhere.toml", "nowhere.toml: no configuration that can be read"),
        ("run smoke --backend mpi", "--backend"),
        ("run smoke --workers 0", "--workers"),
        ("status --out nowhere", "nowhere: no records there"),
        ("frobnicate", "frobnicate"),
    ],
)
def test_wrong_input_is_one_line(
    arguments: str,
    says: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = command(capsys, *arguments.split())
    assert (status, out) == (2, "")
    assert err.count("\n") == 1
    assert says in err


def test_defaults_of_a_configuration() -> None:
    config = parse_config(MATCHES)
    assert isinstance(config, Config)
    assert (config.seed, config.timing) == (0, None)
    assert config.experiment[0].epsilons == (5.0,)
