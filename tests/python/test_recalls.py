"""Measures of registration benchmarks, against their definitions."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cgroup.errors import InputError
from cgroup.evaluation import (
    feature_matching_recall,
    inlier_ratio,
    mean_average_accuracy,
    redwood_error,
    registration_recall,
    rotation_error,
)
from cgroup.rigid.transforms import quaternions, turn
from reference import redwood

ANGLES = st.one_of(
    st.floats(0, np.pi),
    st.sampled_from([0.0, 1e-9, 1e-6, np.pi / 2, 2 * np.pi / 3, np.pi - 1e-6]),
    st.floats(np.pi - 1e-4, np.pi - 1e-9),
)
AXES = st.one_of(
    st.sampled_from([(1, 0, 0), (0, 1, 0), (0, 0, -1), (1, 1, 0), (1, -1, 1)]),
    st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda axis: np.linalg.norm(axis) > 0.1),
)
SEEDS = st.integers(0, 2**32 - 1)


def pose_of(axis, angle, translation):
    x, y, z = np.sin(angle / 2) * np.array(axis) / np.linalg.norm(axis)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn(x, y, z, np.cos(angle / 2)), translation
    return pose


def information_of(rng):
    points = rng.normal(size=(50, 3)) + rng.normal(size=3)
    total = np.zeros((6, 6))
    for x, y, z in points:
        motion = np.hstack([np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]]])
        total += motion.T @ motion
    return total


@given(AXES, ANGLES, SEEDS)
@example((0.0, 0.0, 1.0), np.pi, 8)
def test_redwood_error_is_that_of_the_reference(axis, angle, seed):
    rng = np.random.default_rng(seed)
    translation = rng.normal(size=3)
    error, true = pose_of(axis, angle, translation), pose_of(rng.normal(size=3), 2, rng.normal(size=3))
    information = information_of(rng)
    found = redwood_error(true @ error, true, information)
    expected = redwood.redwood_error(true @ error, true, information)
    if np.pi - abs(angle) < 1e-6 and found != pytest.approx(expected):  # rounding may choose the other sign
        e = np.concatenate([translation, -np.array(axis) / np.linalg.norm(axis)])
        both = [e, e * np.repeat([1, -1], 3)]
        assert any(found == pytest.approx(v @ information @ v / information[0, 0], abs=1e-5) for v in both)
    else:
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)


@given(AXES, ANGLES)
def test_quaternions_and_angles_keep_their_digits(axis, angle):
    pose = pose_of(axis, angle, np.zeros(3))
    expected = np.array([*(np.sin(angle / 2) * np.array(axis) / np.linalg.norm(axis)), np.cos(angle / 2)])
    (found,) = quaternions(pose[None, :3, :3])
    assert found == pytest.approx(expected, abs=1e-12) or found == pytest.approx(-expected, abs=1e-12)
    assert np.radians(rotation_error(pose, np.eye(4))) == pytest.approx(angle, abs=1e-9)


@given(st.lists(st.tuples(st.booleans(), st.sampled_from("abc")), min_size=1, max_size=30))
def test_recall_counts_pairs_or_scenes_alike(pairs):
    registered, scenes = [yes for yes, _ in pairs], [scene for _, scene in pairs]
    assert registration_recall(registered) == pytest.approx(sum(registered) / len(pairs))
    shares = [np.mean([yes for yes, of in pairs if of == scene]) for scene in sorted(set(scenes))]
    assert registration_recall(registered, scenes=scenes) == pytest.approx(np.mean(shares))
    ratios = np.where(registered, 0.06, 0.05)
    assert feature_matching_recall(ratios, scenes=scenes) == pytest.approx(np.mean(shares))


def test_limits_of_matches_are_exclusive():
    target = np.array([[0.1, 0, 0], [0.09, 0, 0]])
    assert inlier_ratio(np.zeros((2, 3)), target, np.eye(4), distance=0.1) == 0.5
    assert inlier_ratio(np.empty((0, 3)), np.empty((0, 3)), np.eye(4)) == 0


def test_mean_average_accuracy_is_the_mean_of_shares():
    assert mean_average_accuracy([1, 2, np.inf], [1, 2, 3]) == pytest.approx((1 / 3 + 2 / 3 + 2 / 3) / 3)
    assert np.isnan(mean_average_accuracy([], [1]))
    assert np.isnan(mean_average_accuracy([1], []))


def test_what_does_not_fit_is_refused():
    with pytest.raises(InputError, match="information: got .*; give a finite 6x6 matrix"):
        redwood_error(np.eye(4), np.eye(4), np.zeros((6, 6)))
    with pytest.raises(InputError, match="scenes: got 1; give one for each of the 2 pairs"):
        registration_recall([True, False], scenes=["a"])
