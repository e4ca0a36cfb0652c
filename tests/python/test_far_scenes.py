"""Scenes far from the origin, as in UTM coordinates: the same poses, deviations and graphs as near it."""

import copy
import pickle
from pathlib import Path

import numpy as np
import pytest

from cgroup.datasets import standin_pair
from cgroup.rigid import apply, invert
from cgroup.rigid.se3 import deviations_at, information_of
from cgroup.scenes import PoseGraph, Scene, register_all

PAIRS = [standin_pair(seed=1, turn=turn, pixels=60) for turn in (40, 80)]
VIEWS = [PAIRS[0].source.points, *(pair.target.points for pair in PAIRS)]
UTM = np.array([5e5, 5e6, 100])


def shifted(place: np.ndarray) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = place
    return pose


@pytest.fixture(scope="module")
def near() -> Scene:
    return register_all(VIEWS)


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize("size", [1.0, 0.1, 0.01])
@pytest.mark.parametrize("place", [np.full(3, 1e6), UTM], ids=["1e6", "UTM"])
def test_far_scenes_are_as_near_ones(near: Scene, place: np.ndarray, size: float, known: bool) -> None:
    clouds, there = [size * view + place for view in VIEWS], shifted(place)
    given = {}
    if known:
        pose = near.poses[2].copy()
        pose[:3, 3] *= size
        given = {2: there @ pose @ invert(there)}
    far = register_all(clouds, known=given)
    assert far.components == near.components
    for row, cloud in enumerate(clouds):
        back = invert(there) @ far.poses[row] @ there
        moved = apply(back, size * VIEWS[row]) / size
        assert np.abs(moved - apply(near.poses[row], VIEWS[row])).max() < 0.02 * near.voxel
        if known:
            continue
        ends = [(near, VIEWS[row], 1.0), (far, cloud, size)]
        deviations = [
            deviations_at(scene.covariance[row], apply(scene.poses[row], points.mean(axis=0)[None])[0])
            for scene, points, _ in ends
        ]
        np.testing.assert_allclose(deviations[1], np.multiply(deviations[0], [1, size]), rtol=0.05)
    if known:
        np.testing.assert_array_equal(far.poses[2], given[2])
    elif size > 0.05:
        np.testing.assert_allclose(far.graph.residuals, near.graph.residuals, rtol=0.02, atol=0.02)


def test_graphs_of_far_scenes_are_written(tmp_path: Path) -> None:
    for size in (1.0, 0.01, 0.001):
        scene = register_all([size * view + UTM for view in VIEWS])
        for name in ("a.g2o", "a.json"):
            scene.write(tmp_path / name)
            assert len(PoseGraph.read(tmp_path / name).edges) == 2


def test_inverses_of_covariances_far_from_the_origin() -> None:
    rng = np.random.default_rng(0)
    root = rng.normal(size=(20, 6, 6))
    near = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(6)
    np.testing.assert_allclose(information_of(near) @ near, np.tile(np.eye(6), (20, 1, 1)), atol=1e-9)


def test_scenes_are_pickled_and_copied(near: Scene) -> None:
    for scene in (pickle.loads(pickle.dumps(near)), copy.deepcopy(near)):
        np.testing.assert_array_equal(scene.poses, near.poses)
        grown = scene.add(VIEWS[0])
        assert grown.components == [[0, 1, 2, 3]]
