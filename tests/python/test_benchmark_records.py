"""What the records say."""

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import benchmark_fakes
from benchmark_runs import CLOUDS, MATCHES, contents, serial
from cgroup import group
from cgroup.benchmark import problem, solving, tables
from cgroup.benchmark.problem import Problem
from cgroup.benchmark.results import Matched, pack, unpack
from cgroup.benchmark.store import RECORDS, read_plan
from cgroup.datasets import standin_pair
from cgroup.errors import InputError, NoConsensusError
from cgroup.evaluation import rotation_error, score_group, translation_error
from cgroup.registration import correspond


@pytest.fixture(scope="module")
def clouds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("clouds")
    serial(CLOUDS + "epsilons = [1, 5]", out)
    return out


def test_records_say_what_the_methods_did(clouds):
    frame = tables.load(str(clouds))
    with pytest.raises(InputError, match="path: got None; give a path"):
        tables.load(None)  # type: ignore[arg-type]
    assert len(frame) == 2 * 2 * 2 * 2  # pairs, levels, methods, thresholds
    assert set(frame["experiments"]) == {("noise",)}
    for row in frame.itertuples():
        case = Problem(
            "experiment",
            "benchmark_fakes:Clouds",
            str(row.pair),
            nuisance=str(row.nuisance),
            level=float(row.level),
        )
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


def test_columns_of_facts_and_plans(clouds):
    frame = tables.load(clouds)
    row = frame.iloc[0]
    assert (row["detector"], row["descriptor"], row["overlap"]) == ("h3d", "shot", 0.9)
    assert np.isnan(row["clutter"])
    assert frame["seconds"].min() > 0
    assert tables.load_machines(clouds)["id"].tolist() == [row["machine"]]
    assert read_plan(clouds, "config")["experiment"][0]["levels"] == [0.1, 0.2]
    assert tables.load_datasets(clouds)["title"].tolist() == ["Clouds"]


def test_protocols_of_a_data_set_are_judged_by_pose_and_precision(clouds, tmp_path):
    frame = tables.load(clouds)
    posed = frame["rotation_error"].notna()
    np.testing.assert_array_equal(frame["ok:rmse<=5pr"].astype(bool), posed & (frame["rmse_pr"] <= 5))
    np.testing.assert_array_equal(frame["registered"], frame["precision"] > 0.1)
    serial(
        MATCHES.replace('"ransac", "gtm"', '"benchmark_fakes:first"').replace(
            '"benchmark_fakes:first"', '{ name = "benchmark_fakes:first", options = { count = 2 } }'
        ),
        tmp_path,
    )
    few = tables.load(tmp_path)
    assert few["rotation_error"].isna().all(), "two matches fix no pose"
    assert few["ok:rmse<=5pr"].tolist() == [False] * len(few)
    assert few["registered"].all()


def test_groups_of_a_case(clouds):
    frame = tables.load(clouds)
    row = frame[frame["epsilon"] == 5].iloc[0]
    matches, pose, masks = tables.load_groups(clouds, row["case"])
    assert len(matches) == row["n"]
    np.testing.assert_allclose(pose[:3, 3], (1, 2, 3))
    assert list(masks) == ["ss", "gc"]
    for method, mask in masks.items():
        np.testing.assert_array_equal(mask, group(matches, method).mask)
    with pytest.raises(InputError, match="no records of the case nothing"):
        tables.load_groups(clouds, "nothing")


def test_the_overlap_error_is_the_mean_displacement_in_pr():
    rng = np.random.default_rng(0)
    source = rng.uniform(size=(3000, 3))
    truth, pose = np.eye(4), np.eye(4)
    pose[0, 3] = 0.06
    sample = problem.overlap_sample(source, source[source[:, 0] < 0.5], truth, 0.01, rng)
    assert len(sample) == problem.OVERLAP_SAMPLE
    assert sample[:, 0].max() < 0.5 + 4 * 0.01
    errors = solving.measure_pose(pose, truth, sample, 0.01)
    assert errors == pytest.approx((0, 0.06, 6))
    assert np.isnan(solving.measure_pose(pose, truth, sample[:0], 0.01)[2])


def test_correspondences_survive_packing():
    pair = standin_pair(pixels=60)
    matches = correspond(pair.source, pair.target)
    sample = pair.source.points[:7]
    given = Matched(matches, pair.T_target_source, sample, 0.25, {"overlap": 0.5})
    found = unpack(pack(given))
    assert pack(found) == pack(given)
    assert (found.pr, found.facts) == (0.25, {"overlap": 0.5})
    np.testing.assert_array_equal(found.truth, given.truth)
    np.testing.assert_array_equal(found.sample, sample)
    for method in ("ss", "si", "3dhv", "ransac"):
        one, other = (group(each, method) for each in (matches, found.matches))
        np.testing.assert_array_equal(one.mask, other.mask)


def test_aggregate():
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
        tables.aggregate(frame, ["method"], how) for how in ("macro", "median", "pooled")
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
        tables.aggregate(frame, ["method"], "mean")  # pyright: ignore[reportArgumentType]


def test_no_records(tmp_path):
    with pytest.raises(InputError, match="no records; make some with"):
        tables.load(tmp_path)
    (tmp_path / RECORDS).write_text("something else\n" * 100)
    with pytest.raises(InputError, match="not a file of records"):
        tables.load(tmp_path)
    with pytest.raises(InputError, match="not a file of records"):
        serial(MATCHES, tmp_path)


def test_a_file_that_sqlite_cannot_read_is_refused_and_left_as_it_is(clouds, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(clouds, out)
    with closing(sqlite3.connect(out / RECORDS)) as connection:
        connection.execute("pragma wal_checkpoint(truncate)")
    content = (out / RECORDS).read_bytes()
    damaged = content[:8192] + bytes(len(content) - 8192)
    (out / RECORDS).write_bytes(damaged)
    with pytest.raises(InputError, match="one that can't be read"):
        tables.load(out)
    with pytest.raises(InputError, match="damaged, or not a file of records .*; move it away"):
        serial(CLOUDS + "epsilons = [1, 5]", out)
    assert (out / RECORDS).read_bytes() == damaged


def test_matches_that_cannot_be_unpacked_are_errors_until_they_are_made_again(clouds, tmp_path):
    out, text = tmp_path / "out", CLOUDS + "epsilons = [1, 5, 9]"
    shutil.copytree(clouds, out)
    with closing(sqlite3.connect(out / RECORDS, isolation_level=None)) as connection:
        connection.execute("update matches set content = zeroblob(7) where rowid = 1")
        [damaged] = connection.execute("select problem from matches where rowid = 1").fetchone()
    with pytest.raises(InputError, match="can't be read"):
        tables.load_groups(out, damaged)
    assert serial(text, out).failed == 2
    assert serial(text, out, retry_failed=True).failed == 0
    serial(text, tmp_path / "whole")
    assert contents(out) == contents(tmp_path / "whole")


def test_another_layout_is_refused(tmp_path):
    with closing(sqlite3.connect(tmp_path / RECORDS)) as connection:
        connection.execute("create table methods (key text)")
        connection.execute("pragma user_version = 5")
    before = (tmp_path / RECORDS).read_bytes()
    for attempt in (lambda: tables.load(tmp_path), lambda: serial(MATCHES, tmp_path)):
        with pytest.raises(
            InputError, match="not a file of records of this version of cgroup; use the version"
        ):
            attempt()
    assert (tmp_path / RECORDS).read_bytes() == before


def test_kinds_of_results_are_checked(clouds):
    with pytest.raises(InputError, match="kind: got 'trials'; choose one of experiment"):
        tables.load(clouds, "trials")  # pyright: ignore[reportArgumentType]
    for kind in ("registration", "scenes", "matches", "timing"):
        frame = tables.load(clouds, kind)
        assert frame.empty
        assert {"dataset", "pair", "seconds"} <= set(frame.columns)
