"""Bags of scans with true poses, and the comparison of ways to make scenes of them."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from benchmark_runs import cgroup_benchmark, serial
from cgroup.benchmark import tables
from cgroup.benchmark.config import parse_config, read_config
from cgroup.benchmark.pipelines import SCENE_SOLVERS
from cgroup.benchmark.plan import make_plan
from cgroup.benchmark.report.pipelines import scene_table
from cgroup.datasets.scan_sets import load_scan_set
from cgroup.errors import InputError
from cgroup.features import resolution
from cgroup.rigid import apply

STONE = """
name = "tiny"
[scenes]
solvers = ["register-all"]
[[scenes.sets]]
id = "one stone"
dataset = "stone:0"
"""

PLACES = """
name = "tiny"
[scenes]
threads = 1
solvers = ["benchmark_fakes:placing", { name = "benchmark_fakes:placing", label = "apart", options = { joined = 1 } }]
[[scenes.sets]]
id = "places"
dataset = ["here", "there"]
seeds = [0, 1, 2, 3]
"""


@pytest.fixture
def places(tmp_path: Path) -> Path:
    """A folder with the data: two places with two small scans each."""
    rng = np.random.default_rng(0)
    for name in ("here", "there"):
        folder = tmp_path / "data" / name
        folder.mkdir(parents=True)
        scans = [{"file": f"{row}.npy", "world_from_scan": np.eye(4).tolist()} for row in range(2)]
        (folder / "set.json").write_text(json.dumps({"scans": scans}))
        for row in range(2):
            np.save(folder / f"{row}.npy", rng.uniform(0, 10, size=(300, 3)))
    return tmp_path / "data"


def gaps_under_the_truth(bag, label):
    """Distances of points of each scan of a place from all the others, in its frame."""
    rows = [row for row, each in enumerate(bag.labels) if each == label]
    placed = [apply(bag.truth[row], bag.scans[row]) for row in rows]
    for row, points in enumerate(placed):
        others = np.concatenate([each for other, each in enumerate(placed) if other != row])
        yield cKDTree(others).query(points)[0]


def test_scans_of_a_bag_meet_under_their_true_poses_mirrored_ones_too():
    bag = load_scan_set(["stone:0", "stone:1"], None, seed=3, mirrored=True)
    assert sorted(set(bag.labels)) == ["stone 0", "stone 0, mirrored", "stone 1", "stone 1, mirrored"]
    assert len(bag.scans) == len(bag.truth) == 24
    assert np.linalg.det(bag.truth[:, :3, :3]) == pytest.approx(np.ones(24))
    for label in set(bag.labels):
        for gaps in gaps_under_the_truth(bag, label):
            assert np.median(gaps) < 2 * resolution(bag.scans[0])


def test_places_that_are_not_there_are_refused(tmp_path):
    with pytest.raises(InputError, match="stone: got 'x'; give its seed, a whole number"):
        load_scan_set(["stone:x"], None, seed=0)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"no scans with poses: no set\.json"):
        load_scan_set(["empty"], tmp_path, seed=0)
    (tmp_path / "empty" / "set.json").write_text('{"scans": [{"file": "a.ply"}]}')
    with pytest.raises(InputError, match="not a list of scans"):
        load_scan_set(["empty"], tmp_path, seed=0)


def test_scans_of_a_stone_become_one_scene_and_the_report_shows_it(tmp_path):
    config, out = tmp_path / "tiny.toml", tmp_path / "out"
    config.write_text(STONE)
    status, printed, errors = cgroup_benchmark("run", config, "--out", out)
    assert (status, errors) == (0, "")
    assert "scenes         1 of 1" in printed
    row = tables.load(out, "scenes").iloc[0]
    assert (row["set"], row["dataset"], row["pair"], row["kind"]) == (
        "one stone",
        "stone:0",
        "seed 0",
        "related",
    )
    assert (row["method"], row["scans"], row["placed"], row["tried"]) == ("register-all", 6, 6, 15)
    assert (row["right"], row["wanted"], row["mixed"], row["error"]) == (1, 1, 0, "")
    assert row["seconds"] == sum(row["stages"].values()) > 0
    assert len(row["rotation"]) == len(row["translation"]) == 15
    assert max(row["rotation"]) < 0.5
    assert cgroup_benchmark("report", "--out", out)[0] == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert 'id="chart-scenes"' in page
    assert "100 100 100 100 100" in page
    assert "1 of 1" in page
    assert 'id="claims-table"' not in page
    assert (out / "figures" / "scenes.png").stat().st_size > 1000


def test_seeds_are_taken_together_in_the_table(tmp_path, places):
    serial(PLACES, tmp_path / "out", root=places)
    frame = tables.load(tmp_path / "out", "scenes")
    assert frame["dataset"].unique().tolist() == ["here + there"]
    assert frame["pair"].tolist() == [f"seed {seed}" for seed in range(4)] * 2
    table = scene_table(frame)
    together, apart = (dict(zip(table.headers, row, strict=True)) for row in table.rows)
    assert [together[name].text for name in ("solver", "components right", "mixed", "placed")] == [
        *("benchmark_fakes:placing", "0 of 8", "4", "16 of 16"),
    ]
    assert [apart[name].text for name in ("components right", "mixed", "placed", "pairs tried")] == [
        *("0 of 8", "0", "0 of 16", "24"),
    ]
    assert apart["median degrees"].text == apart["largest shift"].text == "-"
    assert apart["% within 3/5/10/30/45 degrees"].text == "0 0 0 0 0"
    assert together["% within 0.05/0.1/0.25/0.5/0.75 shift"].text.count(" ") == 4


def test_a_place_that_is_not_at_hand_leaves_its_set_out(tmp_path, places):
    text = PLACES + '[[scenes.sets]]\nid = "gone"\ndataset = ["here", "nowhere"]\n'
    plan = make_plan(parse_config(text), places)
    assert [len(each.problems) for each in plan.sets] == [4, 0]
    assert list(plan.missing) == ["nowhere"]
    assert "no scans with poses: no set.json" in plan.missing["nowhere"]
    config = tmp_path / "tiny.toml"
    config.write_text(STONE.replace("stone:0", "nowhere"))
    status, _, errors = cgroup_benchmark("run", config, "--data", places, "--out", tmp_path / "out")
    assert status == 2
    assert errors.startswith("cgroup: --data: all data sets are missing; nowhere: ")
    assert "no scans with poses" in errors


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"register-all"', '"register"', "got 'register'; choose one of register-all"),
        ('"register-all"', '"open3d-ransac"', "got 'open3d-ransac'; choose one of register-all"),
        ('dataset = "stone:0"', 'dataset = "stone:0"\npairs = 1', "scenes.sets[0].pairs: Extra inputs"),
        ('dataset = "stone:0"', 'dataset = "stone:0"\nseeds = -1', "scenes.sets[0].seeds[0]"),
    ],
)
def test_mistakes_are_named(old, new, message):
    assert old in STONE
    with pytest.raises(InputError) as error:
        parse_config(STONE.replace(old, new))
    assert message in str(error.value)


def test_the_preset_runs_where_no_data_is(monkeypatch):
    monkeypatch.delenv("CGROUP_DATA", raising=False)
    config = read_config("scenes")
    assert config.scenes is not None
    assert {entry.name for entry in config.scenes.solvers} == set(SCENE_SOLVERS)
    plan = make_plan(config, None)
    assert [each.entry.id for each in plan.sets if each.problems] == ["stones"]
    assert "CGROUP_DATA" in plan.missing["scenes/eth_facade_7"]
