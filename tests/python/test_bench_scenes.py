"""Bags of scans with true poses, and the comparison of ways to make scenes of them."""

import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree
from shared_data import data_folder

from cgroup._runtime.progress import StageClock
from cgroup.datasets import standin_pair
from cgroup.errors import InputError
from cgroup.evaluation import score_scene
from cgroup.features import choose_voxel, resolution
from cgroup.rigid import apply

BENCHES = Path(__file__).resolve().parents[2] / "benches"
if not BENCHES.exists():
    pytest.skip("the benches are not part of this copy", allow_module_level=True)
sys.path.insert(0, str(BENCHES))

from peers import scene_solvers  # noqa: E402
from peers import scenes as comparison  # noqa: E402
from peers.scan_sets import ScanSet, load_scan_set, pool_sets  # noqa: E402


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


@pytest.mark.parametrize(
    ("name", "scans"),
    [("stanford_views/bunny", 10), ("stanford_views/happy_stand", 15), ("scenes/redkitchen_2_3", None)],
)
def test_real_scans_meet_under_their_true_poses(name, scans):
    bag = load_scan_set([name], data_folder(name), seed=0)
    assert scans in {None, len(bag.scans)}
    shares = [
        np.mean(gaps < 3 * resolution(bag.scans[0])) for gaps in gaps_under_the_truth(bag, bag.labels[0])
    ]
    assert min(shares) > 0.3


def test_folders_without_poses_are_refused(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"no scans with poses; they come with a set\.json"):
        load_scan_set(["empty"], tmp_path, seed=0)
    (tmp_path / "empty" / "set.json").write_text('{"scans": [{"file": "a.ply"}]}')
    with pytest.raises(InputError, match="not a list of scans"):
        load_scan_set(["empty"], tmp_path, seed=0)


@pytest.mark.parametrize(
    ("run", "modules"),
    [
        (scene_solvers.open3d_multiway, ["open3d"]),
        (scene_solvers.kiss_matcher_gnc, ["kiss_matcher", "gtsam"]),
    ],
)
def test_other_libraries_place_views_that_overlap_much(run, modules):
    for module in modules:
        pytest.importorskip(module, reason=f"{module} isn't installed; pip install 'cgroup[peers]'")
    pairs = [standin_pair(seed=0, turn=turn, pixels=90) for turn in (12.0, 24.0, 36.0)]
    points = [pairs[0].source.points, *(pair.target.points for pair in pairs)]
    truth = np.array([np.eye(4), *(np.linalg.inv(pair.T_target_source) for pair in pairs)])
    bag = pool_sets([ScanSet(points, truth, ["stone"] * 4)], np.random.default_rng(0))
    voxel = choose_voxel(bag.scans[0], bag.scans[1])
    answer = run(scene_solvers.Scans(bag.scans, voxel, threads=2), StageClock())
    assert (answer.components, answer.tried) == ([[0, 1, 2, 3]], 6)
    errors = score_scene(answer.poses, answer.components, bag.truth, bag.labels).summarize()
    assert errors["rotation_largest"] < 5


def test_a_table_has_a_row_of_each_solver_of_a_bag(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["scenes", "stone:0", "--solvers", "cgroup", "cgroup"])
    comparison.main()
    head, _, *rows = (line.strip("|").split("|") for line in capsys.readouterr().out.splitlines())
    found = [[cell.strip() for cell in row] for row in rows]
    assert [row[:4] for row in found] == [["stone:0", "cgroup", "1 of 1, 0 mixed", "6 of 6"]] * 2
    assert {len(row) for row in found} == {len(head)}


def test_a_solver_whose_library_is_absent_is_refused_before_any_runs(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "open3d", None)
    monkeypatch.setattr(sys, "argv", ["scenes", "stone:0", "--solvers", "cgroup", "open3d"])
    with pytest.raises(SystemExit):
        comparison.main()
    printed = capsys.readouterr()
    assert "open3d isn't installed" in printed.err
    assert printed.out == ""
