"""Scores of scenes."""

import numpy as np
import pytest

from cgroup.datasets.generated.stones import random_pose
from cgroup.errors import InputError
from cgroup.evaluation import ecdf, rotation_error, score_scene, translation_error

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


@pytest.mark.parametrize("components", [[[0, 6]], [[-1, 0]], [[0, 1], [1, 2]]])
def test_rows_that_cannot_be_are_refused(truth, components):
    with pytest.raises(InputError, match="components"):
        score_scene(truth, components, truth, LABELS)
