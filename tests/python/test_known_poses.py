"""Scenes with scans of known pose."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cgroup import InputError
from cgroup.datasets import standin_pair
from cgroup.rigid import invert
from cgroup.scenes import Scene, register_all
from cgroup.types import PointCloud

SITE = np.array([4.5e5, 5.4e6, 300.0])


def some_pose(rng, shift=5.0):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(rng.uniform(-1, 1, 3) * np.pi / 2).as_matrix()
    pose[:3, 3] = rng.uniform(-shift, shift, 3)
    return pose


@pytest.fixture(scope="module")
def views():
    """Five views of an object, each in its own frame, and their poses in a site far from the origin."""
    rng = np.random.default_rng(0)
    first = standin_pair(seed=1, turn=30, pixels=60)
    seen = [(first.source, np.eye(4))]
    for turn in (20, 40, 60, 80):
        pair = standin_pair(seed=1, turn=turn, pixels=60)
        seen.append((pair.target, invert(pair.T_target_source)))
    site = some_pose(rng)
    site[:3, 3] += SITE
    scans, poses = [], []
    for cloud, pose in seen:
        moved = some_pose(rng, shift=50.0)
        scans.append(PointCloud(cloud.points @ moved[:3, :3].T + moved[:3, 3]))
        poses.append(site @ pose @ invert(moved))
    return scans, np.array(poses)


@pytest.fixture(scope="module")
def free(views) -> Scene:
    return register_all(views[0])


def largest_error(scan: PointCloud, found: np.ndarray, true: np.ndarray) -> float:
    between = invert(true) @ found
    return float(np.abs(scan.points @ between[:3, :3].T + between[:3, 3] - scan.points).max())


@pytest.mark.parametrize("rows", [[0], [3], [1, 4], [4, 2, 0], [0, 1, 2, 3, 4]])
def test_known_poses_stay_and_give_the_frame(views, rows):
    scans, poses = views
    scene = register_all(scans, known={row: poses[row] for row in rows})
    assert scene.components == [[0, 1, 2, 3, 4]]
    assert np.array_equal(scene.poses[rows], poses[rows])
    assert max(map(largest_error, scans, scene.poses, poses)) < scene.voxel
    assert not scene.covariance[rows].any()
    others = [row for row in range(5) if row not in rows]
    assert (np.linalg.eigvalsh(scene.covariance[others])[:, -1] > 0).all()
    assert not any("contradict" in note for note in scene.notes)


def test_one_known_pose_only_moves_the_scene(views, free):
    scans, poses = views
    scene = register_all(scans, known={2: poses[2]})
    moved = poses[2] @ invert(free.poses[2]) @ free.poses
    assert max(map(largest_error, scans, scene.poses, moved)) < 0.01 * scene.voxel


def test_a_contradiction_of_known_poses_is_stated(views):
    scans, poses = views
    wrong = poses.copy()
    wrong[3, 0, 3] += 20.0
    scene = register_all(scans, known={row: wrong[row] for row in (0, 3)}, names=list("abcde"))
    assert np.array_equal(scene.poses[[0, 3]], wrong[[0, 3]])
    (note,) = [note for note in scene.notes if "d on a: their surfaces contradict the known poses" in note]
    assert float(note.split()[-4]) == pytest.approx(20, abs=scene.voxel)


def test_known_scans_without_overlap_are_one_component(views):
    other = standin_pair(seed=4, turn=30, pixels=60).source
    poses = {0: views[1][0], 1: some_pose(np.random.default_rng(3))}
    scene = register_all([views[0][0], other], known=poses)
    assert scene.components == [[0, 1]]
    assert np.array_equal(scene.poses, np.array([poses[0], poses[1]]))


def test_a_component_without_known_scans_keeps_its_own_frame(views):
    pair = standin_pair(seed=4, turn=30, pixels=60)
    scene = register_all([*views[0][:3], pair.source, pair.target], known={1: views[1][1]})
    assert scene.components == [[0, 1, 2], [3, 4]]
    assert np.array_equal(scene.poses[3], np.eye(4))
    assert np.array_equal(scene.poses[1], views[1][1])


def test_an_added_scan_keeps_the_known_frame(views):
    scans, poses = views
    scene = register_all(scans[:4], known={1: poses[1]}).add(scans[4])
    assert np.array_equal(scene.poses[1], poses[1])
    assert largest_error(scans[4], scene.poses[4], poses[4]) < scene.voxel


@pytest.mark.parametrize(
    ("known", "message"),
    [
        ([np.eye(4)], "known"),
        ({5: np.eye(4)}, "below 5"),
        ({0: 2 * np.eye(4)}, "known"),
        ({"a": np.eye(4)}, "known"),
    ],
)
def test_wrong_known_poses_are_refused(views, known, message):
    with pytest.raises(InputError, match=message):
        register_all(views[0], known=known)
