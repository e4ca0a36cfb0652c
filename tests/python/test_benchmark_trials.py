"""The comparison of grouping methods on matches: what is planned, run, recorded, ranked and reported."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark_runs import serial
from cgroup.benchmark import tables
from cgroup.benchmark.config import parse_config
from cgroup.benchmark.plan import make_plan
from cgroup.benchmark.report import write_report
from cgroup.benchmark.report.trials import describe_set, failure_table, level_table
from cgroup.benchmark.results import KILLED
from cgroup.benchmark.run import Summary
from cgroup.benchmark.stats import comparable, rank_methods
from cgroup.cli import main

GRID = """
name = "tiny"
[trials]
threads = [1, 0]
methods = ["gtm", "ransac", "benchmark_fakes:first"]
[[trials.sets]]
id = "grid"
grid = { n = [40, 20], inliers = [0, 0.1, 0.5], frames = ["good", "none"], repeats = 2 }
"""

MATCHES = """
name = "tiny"
[trials]
methods = [
  "ss",
  "ransac",
  { name = "benchmark_fakes:failing", label = "failing" },
  { name = "benchmark_fakes:deadly", label = "deadly" },
  { name = "benchmark_fakes:several", label = "several" },
]
[[trials.sets]]
id = "bare"
dataset = "benchmark_fakes:Matches"
pairs = 4
whole = 8
"""

CLOUDS = """
name = "tiny"
methods = ["ransac"]
[[trials.sets]]
id = "views"
dataset = "benchmark_fakes:Views"
matches = "C1"
mirrored = 1
mixed = 2
[trials]
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("trials")
    serial(GRID, out)
    return out


@pytest.fixture(scope="module")
def frame(finished: Path) -> pd.DataFrame:
    return tables.load(finished, "matches")


@pytest.fixture(scope="module")
def bare(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Summary]:
    out = tmp_path_factory.mktemp("bare")
    return out, serial(MATCHES, out)


def test_every_method_is_tried_on_every_problem(frame):
    # 10 % of 20 are too few to be worth a problem.
    assert frame["case"].nunique() == (2 * 3 - 1) * 2 * 2
    assert len(frame) == frame["case"].nunique() * 3 * 2
    assert frame["error"].eq("").all()
    assert frame["skipped"].eq("").all()
    assert frame["seconds"].gt(0).all()
    assert (frame["kind"] == "related").eq(frame["inliers"] > 0).all()


def test_the_number_of_threads_changes_no_answer(frame):
    answers = ["selected", "selected_correct", "rotation_error", "rmse_pr"]
    one, all_cores = (
        frame[frame["threads"] == count].set_index(["case", "method"])[answers] for count in (1, 0)
    )
    pd.testing.assert_frame_equal(one, all_cores.loc[one.index])


def test_groups_and_poses_are_judged(frame):
    easy = frame[(frame["inliers"] == 0.5) & (frame["method"] == "gtm")]
    assert easy["f_score"].mean() > 0.8
    assert easy["right"].mean() > 0.8
    assert (easy["right"] <= easy["best_right"]).all()
    np.testing.assert_array_equal(easy["correct"], (easy["n"] * easy["inlier_ratio"]).round())
    nothing = frame[frame["inliers"] == 0]
    assert not nothing[["right", "best_right"]].any(axis=None)
    assert nothing["rotation_error"].isna().all()


def test_the_table_of_levels_spreads_one_over_columns(frame):
    table = level_table(comparable(frame))
    assert table is not None
    assert table.headers == ("method", "share of correct ones", "matches", "good", "none")


def test_what_cannot_be_run_is_recorded(bare):
    out, summary = bare
    found = tables.load(out, "matches")
    assert summary.counts["matches"].wanted == len(found) == 20
    by_method = found.groupby("method")
    assert set(by_method.get_group("ss")["skipped"]) == {"needs similarity, which these matches lack"}
    assert set(by_method.get_group("failing")["error"]) <= {"", "ArithmeticError: too far to the right"}
    assert set(by_method.get_group("deadly")["error"]) <= {"", KILLED}
    assert summary.failed == found["error"].ne("").sum() > 0
    usable = comparable(found)
    assert "ss" not in set(usable["method"])
    failed = usable[usable["error"] != ""]
    assert failed["f_score"].eq(0).all(), "what failed counts as a failure"
    assert not failed["right"].any()


def test_the_best_offered_pose_is_judged_by_the_truth(bare):
    rows = tables.load(bare[0], "matches")
    several = rows[rows["method"] == "several"]
    assert not several["right"].any()
    assert several["best_right"].all()
    assert (several["offered"] == 2).all()
    assert (several["ok"] == True).all()  # noqa: E712 - of three values
    assert not several["complete"].any()
    table = failure_table(rows)
    chosen = next(row for row in table.rows if row[0].text == "several")
    assert [cell.text for cell in chosen[1:4]] == ["0.000", "1.000", "0.000"]


def test_a_part_of_a_test_set_is_named_as_one(bare):
    label = describe_set(tables.load(bare[0], "matches"), tables.load_machines(bare[0]))
    assert "4 problems of the 8 of the test set" in label
    assert "within 5 times the resolution (5 in the data's unit)" in label


def test_calls_that_take_too_long_are_given_up_and_tried_again_with_more_time(tmp_path, monkeypatch):
    given, _, sets = MATCHES.partition("methods = ")
    text = f'{given}limit = 1\nmethods = ["benchmark_fakes:endless"]\n{sets[sets.index("[[") :]}'
    serial(text, tmp_path)
    given_up = tables.load(tmp_path, "matches")["skipped"].tolist()
    assert given_up == ["took longer than 1 s"] * 2 + ["not run: took longer than 1 s on 60 matches"] * 2
    monkeypatch.setenv("FAKES_END", "1")
    assert serial(text, tmp_path).counts["matches"].wanted == 4
    assert tables.load(tmp_path, "matches")["skipped"].ne("").sum() == 4, "nothing is tried again as it is"
    serial(text.replace("limit = 1", "limit = 60"), tmp_path)
    assert tables.load(tmp_path, "matches")["skipped"].eq("").all()


def test_unrelated_clouds_have_no_right_answer(tmp_path):
    serial(CLOUDS, tmp_path)
    rows = tables.load(tmp_path, "matches")
    counts = rows.groupby("kind").size().to_dict()
    assert counts == {"related": 3, "mirrored": 1, "mixed": 2}
    unrelated = rows[rows["kind"] != "related"]
    assert unrelated["correct"].eq(0).all()
    assert not unrelated["right"].any()
    assert rows[rows["kind"] == "related"]["correct"].gt(0).all()
    by_overlap = level_table(comparable(rows))
    assert by_overlap is not None
    assert by_overlap.headers == ("method", "0.7 to 1 (3)")


def test_the_report_shows_each_set(finished):
    page = write_report(finished).read_text()
    assert "Methods on matches: grid" in page
    assert "Ranking by F, with 95% intervals" in page
    assert (finished / "figures" / "trials-grid.png").exists()


def print_rankings(finished: Path, capsys: pytest.CaptureFixture[str], *options: str) -> str:
    with pytest.raises(SystemExit) as done:
        main(["benchmark", "rankings", "--out", str(finished), *options])
    assert done.value.code == 0
    return capsys.readouterr().out


def test_rankings_are_printed(finished, capsys):
    lines = print_rankings(finished, capsys).splitlines()
    assert max(map(len, lines)) <= 80
    assert {"All sets", "grid"} <= set(lines)
    assert any(line.startswith("Left out: ") for line in lines)
    wide = print_rankings(finished, capsys, "--wide")
    assert "tied with the first in" in wide
    assert "Left out" not in wide


def test_rankings_as_json_are_those_of_python(finished, frame, capsys):
    found = json.loads(print_rankings(finished, capsys, "--json"))["results"]["sets"]["grid"]
    ranks = rank_methods(frame[frame["threads"] == 1])
    assert [row["method"] for row in found] == [rank.method for rank in ranks]
    assert [row["f_score"]["mean"] for row in found] == [rank.f_score.mean for rank in ranks]


def test_presets_give_methods_their_options():
    text = GRID.replace("[[trials.sets]]", '[[trials.sets]]\npreset = "legacy_header"')
    (planned,) = make_plan(parse_config(text), None).sets
    options = {method.name: method.options for method in planned.solvers}
    assert options["ransac"] == '{"iterations": 5000}'
    assert options["gtm"] == "{}"


COLUMNS = ["case", "method", "f_score", "right", "kind", "correct", "skipped"]


def test_ranks_tell_a_difference_from_chance():
    rng = np.random.default_rng(0)
    base = rng.uniform(0.4, 0.6, size=40)
    scores = {"good": base + 0.2, "as good": base + 0.2 + rng.normal(scale=0.02, size=40), "bad": base}
    rows = [
        [str(i), method, value, value > 0.5, "related", 5, ""]
        for method, values in scores.items()
        for i, value in enumerate(values)
    ]
    ranks = {rank.method: rank for rank in rank_methods(pd.DataFrame(rows, columns=COLUMNS))}
    assert list(ranks)[-1] == "bad"
    assert ranks["good"].f_tied
    assert ranks["as good"].f_tied
    assert not ranks["bad"].f_tied
    assert not ranks["bad"].registered_tied
    assert ranks["bad"].p_f_score < 0.001


def test_a_pair_without_right_matches_counts_as_not_registered():
    rows = [["a", "lc", 0.9, True, "related", 9, ""], ["b", "lc", 0.0, False, "related", 0, ""]]
    (rank,) = rank_methods(pd.DataFrame(rows, columns=COLUMNS))
    assert (rank.registered.mean, rank.f_score.mean) == (0.5, 0.45)


def test_no_answer_no_rank():
    nothing = pd.DataFrame([["a", "lc", 0.0, False, "mixed", 0, ""]], columns=COLUMNS)
    assert rank_methods(nothing) == []
