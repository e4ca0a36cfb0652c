"""The comparison of pipelines: what is planned, run, recorded and reported."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from benchmark_runs import serial
from cgroup.benchmark import tables
from cgroup.benchmark.config import parse_config
from cgroup.benchmark.pipelines import PIPELINES
from cgroup.benchmark.plan import make_plan
from cgroup.benchmark.report import write_report
from cgroup.benchmark.report.pipelines import (
    answer_table,
    calibration_table,
    detail_table,
    trust_table,
)
from cgroup.errors import InputError

SETS = """
name = "tiny"
[registration]
threads = 1
pipelines = [
  { name = "benchmark_fakes:shifting", label = "right" },
  { name = "benchmark_fakes:shifting", label = "rough", options = { by = 0.5, ok = false } },
  { name = "benchmark_fakes:shifting", label = "wrong", options = { by = 50 } },
  { name = "benchmark_fakes:poseless", label = "none" },
]
[[registration.sets]]
id = "views"
dataset = "benchmark_fakes:Views"
loose = "kitti"
strict = "3dmatch"
"""


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("registration")
    serial(SETS + "mirrored = 2\nmixed = 4\n", out)
    return out


@pytest.fixture
def frame(finished: Path) -> pd.DataFrame:
    return tables.load(finished, "registration")


def test_every_pipeline_registers_every_pair(frame):
    assert len(frame) == 4 * (3 + 2 + 4)
    assert frame["error"].eq("").all()
    counts = frame.drop_duplicates(["pair", "other", "kind"]).groupby("kind").size()
    assert counts.to_dict() == {"related": 3, "mirrored": 2, "mixed": 4}
    mixed = frame[frame["kind"] == "mixed"]
    assert (mixed["pair"] != mixed["other"]).all()


def test_poses_are_judged_by_both_limits(frame):
    related = frame[frame["kind"] == "related"].set_index("method")
    judged = related[["right", "accurate"]].groupby("method").all()
    assert judged["right"].to_dict() == {"right": True, "rough": True, "wrong": False, "none": False}
    assert judged["accurate"].to_dict() == {"right": True, "rough": False, "wrong": False, "none": False}
    np.testing.assert_allclose(related.loc["rough", "translation_error"], 0.5)
    np.testing.assert_allclose(related.loc["rough", "rmse_pr"] * related.loc["rough", "pr"], 0.5)
    assert related.loc["none", "rotation_error"].isna().all()
    assert not related.loc["none", "ok"].any(), "an answer without a pose can't be ok"
    assert (related.loc["rough", "probability"] == 0.25).all()


def test_unrelated_clouds_have_no_right_pose(frame):
    unrelated = frame[frame["kind"] != "related"]
    assert not unrelated["right"].any()
    assert unrelated[["rotation_error", "overlap"]].isna().all(axis=None)
    assert unrelated[unrelated["method"] == "wrong"]["ok"].all()


def test_a_missing_library_leaves_its_pipelines_out(monkeypatch):
    monkeypatch.setitem(PIPELINES, "open3d-fgr", PIPELINES["open3d-fgr"]._replace(needs="no_such_library"))
    text = SETS.replace('{ name = "benchmark_fakes:poseless", label = "none" }', '"open3d-fgr"')
    plan = make_plan(parse_config(text.replace("threads = 1", "threads = 1\nlimit = 5")), None)
    assert [pipeline.label for pipeline in plan.sets[0].solvers] == ["right", "rough", "wrong"]
    assert plan.sets[0].limit == 5
    assert "no_such_library can't be imported" in plan.missing["open3d-fgr"]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("benchmark_fakes:poseless", "open3d", "got 'open3d'; choose one of cgroup"),
        ("benchmark_fakes:poseless", "benchmark_fakes:NOT_A_FUNCTION", "is a int; name a function"),
        ("by = 50", "bi = 50", "has no 'bi'; it takes by, ok"),
        ('label = "wrong"', 'label = "right"', "give each variant a label of its own"),
        ('loose = "kitti"', 'loose = "rmse<=1pr"', "choose a limit of the rotation: 5deg"),
        ("[[registration.sets]]", "[[registration.pairs]]", "registration.sets: Field required"),
        ('id = "views"', 'id = "views"\nvoxel = 0', "sets[0].voxel"),
        ('id = "views"', 'id = "views"\nwithout = ["write"]', "without 'write', but the pipelines are right"),
        ("threads = 1", "threads = 0", "registration.threads"),
    ],
)
def test_mistakes_are_named(old, new, message):
    assert old in SETS
    with pytest.raises(InputError) as error:
        parse_config(SETS.replace(old, new))
    assert message in str(error.value)


def test_sets_need_clouds_and_names_of_their_own():
    with pytest.raises(InputError, match="registration needs clouds"):
        make_plan(parse_config(SETS.replace("Views", "Matches")), None)
    again = "[[registration.sets]]" + SETS.partition("[[registration.sets]]")[2]
    with pytest.raises(InputError, match="give each an id of its own"):
        parse_config(SETS + again)


def test_a_set_has_its_voxel_its_pipelines_and_a_split_by_overlap(tmp_path):
    more = 'voxel = 0.125\npairs = 1\nwithout = ["wrong", "none"]\nsplit_overlap = 0.95\n'
    serial(SETS + more, tmp_path)
    found = tables.load(tmp_path, "registration")
    assert (found["voxel"] == 0.125).all()
    assert found["method"].tolist() == ["right", "rough"]
    assert set(found["column"]) == {"views, overlap < 0.95"}
    assert answer_table(found).headers[1] == "views, overlap < 0.95 (1)"


def test_answers_are_counted(frame):
    table = answer_table(frame[frame["kind"] == "related"])
    assert table.headers == ("pipeline", "views (3)")
    rows = {row[0].text: row[1] for row in table.rows}
    assert [cell.text for cell in rows.values()] == ["3 / 3", "3 / 0", "0 / 0", "0 / 0"]
    assert [cell.best for cell in rows.values()] == [True, True, False, False]


def test_what_is_trusted_is_counted(frame):
    table = trust_table(frame)
    assert table.headers[1:4] == ("s, views", "right refused", "wrong accepted")
    rows = {row[0].text: [cell.text for cell in row[2:]] for row in table.rows}
    # right refused, wrong accepted, mirrored accepted, unrelated accepted
    assert rows["right"] == ["0 of 3", "-", "2 of 2", "4 of 4"]
    assert rows["rough"] == ["3 of 3", "-", "0 of 2", "0 of 4"]
    assert rows["wrong"] == ["-", "3 of 3", "2 of 2", "4 of 4"]
    assert rows["none"] == ["-", "0 of 3", "0 of 2", "0 of 4"]


def test_errors_of_correct_poses_are_medians(frame):
    related = frame[frame["kind"] == "related"]
    table = detail_table(related)
    rough = {row[1].text: [cell.text for cell in row[2:5]] for row in table.rows}["rough"]
    voxels = related.loc[related["method"] == "rough", "voxel"]
    assert rough == ["3", "0.00", f"{(0.5 / voxels).median():.2f}"]


def test_the_page_shows_the_comparison_alone(finished):
    page = write_report(finished).read_text(encoding="utf-8")
    assert "Registration of whole clouds" in page
    assert 'id="chart-registration"' in page
    assert "3 / 3" in page
    assert 'id="claims-table"' not in page
    assert (finished / "figures" / "registration.png").stat().st_size > 1000


def test_stated_and_true_wrong_poses_are_beside_each_other():
    """Mirrored pairs do not count: the right pose of their mirrored source is no chance."""
    kinds = ["related"] * 20 + ["mixed"] * 10 + ["mirrored"] * 5
    rows = pd.DataFrame({"set": "views", "method": "one", "kind": kinds})
    rows["ok"] = rows["kind"] != "mirrored"
    rows["right"] = rows["kind"] == "related"
    rows["probability"], rows["nees"] = rows["ok"].astype(float), 6.0
    rows["decoy"] = np.where(rows["kind"] == "mirrored", 0.99, 0.01)
    rows.loc[:3, "decoy"] = 0.9
    rows.loc[4, "decoy"] = np.nan

    def stated(frame: pd.DataFrame) -> str:
        table = calibration_table(frame)
        return table.rows[0][
            table.headers.index("wrong accepted, mirrored pairs left out: true; stated")
        ].text

    assert stated(rows) == "10; 4 (1.1 to 10.2)"
    assert stated(rows.assign(ok=False)) == "-"
    assert stated(rows.assign(decoy=np.nan)) == "-"
