"""Scores of scenes, and the comparison of ways to make them."""

import itertools

import numpy as np
import pytest
from scipy.spatial import cKDTree
from shared_data import data_folder

from cgroup._runtime.progress import StageClock
from cgroup.benchmark.pipelines import scenes
from cgroup.datasets import standin_pair
from cgroup.datasets.generated.shapes import random_pose
from cgroup.datasets.scan_sets import ScanSet, load_scan_set, pool_sets
from cgroup.errors import InputError
from cgroup.evaluation import ecdf, rotation_error, score_scene, translation_error
from cgroup.features import choose_voxel, resolution
from cgroup.rigid import apply

LABELS = ["a", "b", "a", "b", "a", "c"]


@pytest.fixture
def truth():
    rng = np.random.default_rng(0)
    return np.array([random_pose(rng) for _ in LABELS])


def test_true_poses_in_any_frames_of_components_score_without_error(truth):
    rng = np.random.default_rng(1)
    frames = {label: random_pose(rng) for label in LABELS}
    poses = np.array([frames[label] @ pose for label, pose in zip(LABELS, truth, strict=True)])
    score = score_scene(poses, [[0, 2, 4], [1, 3], [5]], truth, LABELS)
    assert score.rotation == pytest.approx(np.zeros(4), abs=1e-5)
    assert score.translation == pytest.approx(np.zeros(4), abs=1e-9)
    assert (score.right, score.mixed, score.found, score.wanted, score.placed) == (2, 0, 2, 2, 5)


def test_errors_are_those_of_relative_poses(truth):
    rng = np.random.default_rng(2)
    poses = np.array([random_pose(rng) for _ in LABELS])
    score = score_scene(poses, [[0, 2, 4], [1, 3]], truth, LABELS)
    pairs = [(0, 2), (0, 4), (1, 3), (2, 4)]
    relative = [
        [np.linalg.inv(each[target]) @ each[source] for each in (poses, truth)] for source, target in pairs
    ]
    assert score.rotation == pytest.approx([rotation_error(*both) for both in relative])
    assert score.translation == pytest.approx([translation_error(*both) for both in relative])


def test_scans_apart_fail_and_mixed_components_are_not_right(truth):
    score = score_scene(truth, [[0, 2, 1], [4]], truth, LABELS)
    assert np.isinf(score.rotation).tolist() == [False, True, True, True]
    assert (score.right, score.mixed, score.found, score.placed) == (0, 1, 1, 3)
    assert ecdf(score.translation, [0.1, 1.0]) == pytest.approx([0.25, 0.25])
    summary = score.summarize()
    assert summary["translation_largest"] == pytest.approx(0, abs=1e-9)
    nothing = score_scene(truth, [], truth, LABELS).summarize()
    assert np.isnan(list(nothing.values())).all()


def test_poses_of_scans_in_no_component_are_not_read(truth):
    poses = truth.copy()
    poses[5] = np.nan
    assert score_scene(poses, [[0, 2, 4], [1, 3]], truth, LABELS).right == 2


def test_shares_without_errors_are_unknown():
    assert np.isnan(ecdf(np.empty(0), [1.0, 2.0])).all()


@pytest.mark.parametrize("components", [[[0, 6]], [[-1, 0]], [[0, 1], [1, 2]]])
def test_rows_that_cannot_be_are_refused(truth, components):
    with pytest.raises(InputError, match="components"):
        score_scene(truth, components, truth, LABELS)


def test_components_are_read_once(truth):
    score = score_scene(truth, (part for part in ([0, 2, 4], [1, 3])), truth, LABELS)
    assert (score.right, score.mixed, score.found, score.placed) == (2, 0, 2, 5)


def test_components_without_end_are_refused(truth):
    with pytest.raises(InputError, match="components: got more than 6"):
        score_scene(truth, itertools.repeat([]), truth, LABELS)


def test_shapes_that_do_not_fit_are_refused(truth):
    with pytest.raises(InputError, match=r"poses: got shape \(5, 4, 4\)"):
        score_scene(truth[:5], [], truth, LABELS)


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
    [(scenes.open3d_multiway, ["open3d"]), (scenes.kiss_matcher_gnc, ["kiss_matcher", "gtsam"])],
)
def test_other_libraries_place_views_that_overlap_much(run, modules):
    for module in modules:
        pytest.importorskip(module, reason=f"{module} isn't installed; pip install 'cgroup[peers]'")
    pairs = [standin_pair(seed=0, turn=turn, pixels=90) for turn in (12.0, 24.0, 36.0)]
    points = [pairs[0].source.points, *(pair.target.points for pair in pairs)]
    truth = np.array([np.eye(4), *(np.linalg.inv(pair.T_target_source) for pair in pairs)])
    bag = pool_sets([ScanSet(points, truth, ["stone"] * 4)], np.random.default_rng(0))
    voxel = choose_voxel(bag.scans[0], bag.scans[1])
    answer = run(scenes.Scans(bag.scans, voxel, threads=2), StageClock())
    assert (answer.components, answer.tried) == ([[0, 1, 2, 3]], 6)
    errors = score_scene(answer.poses, answer.components, bag.truth, bag.labels).summarize()
    assert errors["rotation_largest"] < 5
