"""Many scans in, scenes out: what agrees, what hangs together, and whole runs on generated scans."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cgroup.datasets import standin_pair
from cgroup.errors import InputError
from cgroup.io import write_cloud
from cgroup.rigid import invert
from cgroup.rigid.se3 import rotation_vectors
from cgroup.scenes import register_all
from cgroup.scenes.agreement import (
    find_triangles,
    squared_errors,
    weigh_by_triangles,
)
from cgroup.scenes.building import SceneBuilder
from cgroup.scenes.decide import decide, drop_contradicted, drop_weak_bridges
from cgroup.scenes.links import Link
from cgroup.scenes.partners import _fisher_vector, choose_partners
from cgroup.types import PointCloud
from reference import scenes as reference

SEEDS = st.integers(0, 2**32 - 1)


def some_pose(rng, turn=np.pi, shift=5.0):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(rng.uniform(-1, 1, 3) * turn / 2).as_matrix()
    pose[:3, 3] = rng.uniform(-shift, shift, 3)
    return pose


def some_covariance(rng):
    factor = rng.normal(size=(6, 6)) * 0.05
    return factor @ factor.T


@settings(deadline=None)
@given(seed=SEEDS)
def test_errors_are_weighed_as_the_equations_say(seed):
    rng = np.random.default_rng(seed)
    expected = [some_pose(rng) for _ in range(4)]
    found = [pose @ some_pose(rng, 0.5, 0.2) for pose in expected]
    covariance = [some_covariance(rng) for _ in range(4)]
    middles, voxel = rng.normal(size=(4, 3)), rng.uniform(0.1, 1)
    told = squared_errors(np.array(found), np.array(expected), np.array(covariance), middles, voxel)
    cases = zip(found, expected, covariance, middles, strict=True)
    assert told == pytest.approx([reference.squared_error(*case, voxel) for case in cases], rel=1e-6)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, 1), (0.6, 0, 0.8)])
def test_half_a_turn_is_an_error(axis):
    turned = np.eye(4)
    turned[:3, :3] = 2 * np.outer(axis, axis) - np.eye(3)
    (vector,) = rotation_vectors(turned[None, :3, :3])
    assert np.abs(vector) == pytest.approx(np.pi * np.array(axis))


@settings(deadline=None)
@given(seed=SEEDS)
def test_every_triangle_is_found_once(seed):
    rng = np.random.default_rng(seed)
    pairs = rng.permuted(
        [pair for pair in itertools.combinations(range(6), 2) if rng.random() < 0.7] or [(0, 1)], axis=1
    )
    found = find_triangles(np.array(pairs), 6)
    assert len(found) == len({tuple(row) for row in found.tolist()})
    assert {tuple(sorted(row)) for row in found.tolist()} == reference.triangles(pairs.tolist())


@settings(deadline=None)
@given(seed=SEEDS)
def test_a_scan_is_described_by_the_gradients_of_its_likelihood(seed):
    rng = np.random.default_rng(seed)
    values, means = rng.normal(size=(12, 3)), rng.normal(size=(4, 3))
    weights, variances = rng.dirichlet(np.ones(4)), rng.uniform(0.5, 2, (4, 3))
    told = _fisher_vector(values, weights, means, variances)
    assert told == pytest.approx(reference.fisher_vector(values, weights, means, variances), abs=1e-6)


def links_of(rng, poses, wrong, p=0.95):
    """Links between all pairs of scans; the wrong ones lead anywhere."""
    links = {}
    for one, other in itertools.combinations(range(len(poses)), 2):
        pose = invert(poses[one]) @ poses[other]
        if (other, one) in wrong:
            pose = some_pose(rng)
        links[other, one] = Link(pose[None], np.array([p]), 1e-4 * np.eye(6), 0.5, 0.5)
    return links


@settings(deadline=None, max_examples=30)
@given(seed=SEEDS)
def test_wrong_poses_are_dropped_where_half_are_wrong(seed):
    rng = np.random.default_rng(seed)
    poses = np.array([some_pose(rng) for _ in range(12)])
    pairs = [(other, one) for one, other in itertools.combinations(range(12), 2)]
    wrong = {pairs[row] for row in rng.choice(len(pairs), len(pairs) // 2, replace=False)}
    links = links_of(rng, poses, wrong)
    decision = decide(links, dict.fromkeys(links, 0.95), (), np.zeros((12, 3)), 0.1)
    assert not wrong & set(decision.kept)
    main = decision.components[0]
    right = [invert(poses[main[0]]) @ poses[row] for row in main]
    assert np.abs(decision.poses[main] - right).max() < 1e-3


def weighed(wrong, overlap, count=6):
    """Probabilities of poses that are .6 likely by themselves; whether each is one of the wrong ones."""
    rng = np.random.default_rng(0)
    links = links_of(rng, np.array([some_pose(rng) for _ in range(count)]), wrong)
    pairs = sorted(links)
    measured, spread = (
        np.array([getattr(links[pair], name) for pair in pairs]) for name in ("pose", "covariance")
    )
    prior, shares = np.full(len(pairs), 0.6), np.full(len(pairs), overlap)
    told = weigh_by_triangles(np.array(pairs), measured, spread, prior, shares, np.zeros((count, 3)), 0.1)
    return told, np.array([pair in wrong for pair in pairs])


def test_triangles_tell_the_wrong_from_the_right():
    chances, is_wrong = weighed({(3, 1), (5, 2)}, 0.2)
    assert chances[is_wrong].max() < 0.05
    assert chances[~is_wrong].min() > 0.95


def test_scans_that_show_the_same_confirm_nothing():
    assert weighed(set(), 0.02, 4)[0].min() > 0.98
    assert weighed(set(), 1.0, 4)[0] == pytest.approx(np.full(6, 0.6))
    assert weighed(set(), 0.9, 4)[0].max() < 0.7


def test_doubtful_poses_join_no_two_parts():
    pairs = np.array([(1, 0), (2, 1), (4, 3), (5, 4), (3, 0), (4, 1)])
    sure, firm = np.array([0.99, 0.99, 0.99, 0.99, 0.6, 0.6]), np.zeros(6, dtype=bool)
    assert drop_weak_bridges(pairs, sure, firm, 6).tolist() == [True, True, True, True, False, False]
    sure[4:] = 0.85  # together as good as one that is sure
    assert drop_weak_bridges(pairs, sure, firm, 6).all()
    pairs[5] = (4, 0)  # of the same scan
    assert drop_weak_bridges(pairs, sure, firm, 6).tolist() == [True, True, True, True, False, False]
    firm[4] = True  # by a union
    assert drop_weak_bridges(pairs, sure, firm, 6).all()
    assert drop_weak_bridges(pairs[:1], np.array([0.6]), firm[:1], 2).all()


def test_a_single_scan_hangs_on_a_part_by_two_doubtful_poses():
    pairs = np.array([(1, 0), (2, 1), (3, 0), (4, 1), (4, 2)])
    sure = np.array([0.99, 0.99, 0.6, 0.6, 0.6])
    assert drop_weak_bridges(pairs, sure, sure > 0.9, 5).tolist() == [True, True, False, True, True]
    pairs = np.append(pairs, [(6, 5), (4, 5), (4, 6)], axis=0)  # as well on another part
    sure = np.append(sure, [0.99, 0.6, 0.6])
    expected = [True, True, False, False, False, True, False, False]
    assert drop_weak_bridges(pairs, sure, sure > 0.9, 7).tolist() == expected


def test_a_scan_that_others_contradict_is_linked_with_none():
    pairs = np.array([(1, 0), (2, 0), (2, 1), (3, 0), (3, 1), (3, 2)])
    sure, kept = np.full(6, 0.95), np.array([True, True, True, True, False, False])
    firm = drop_contradicted(pairs, kept, sure, sure, 4)
    assert firm.tolist() == [True, True, True, False, False, False]


def test_partners_are_the_most_alike_that_are_left():
    similarity = np.array([[1, 0.9, 0.8, 0.1], [0.9, 1, 0.2, 0.3], [0.8, 0.2, 1, 0.7], [0.1, 0.3, 0.7, 1]])
    assert choose_partners(similarity, [], None, 1) == [(1, 0), (2, 0), (3, 2)]
    assert choose_partners(similarity, [(1, 0)], None, 1) == [(2, 0), (3, 2), (3, 1)]
    assert choose_partners(similarity, [], [0, 0, 2, 3], 1) == [(2, 0), (3, 2), (3, 1)]


@pytest.fixture(scope="module")
def bag():
    """Views of two objects, each in a frame of its own: scans, true poses, and objects."""
    rng = np.random.default_rng(0)
    scans, poses, objects = [], [], []
    for label in (1, 4):
        first = standin_pair(seed=label, turn=30, pixels=60)
        views = [(first.source, np.eye(4))]
        views += [
            (view.target, invert(view.T_target_source))
            for view in (standin_pair(seed=label, turn=turn, pixels=60) for turn in (30, 60))
        ]
        for cloud, pose in views:
            moved = some_pose(rng, shift=50.0)
            scans.append(PointCloud(cloud.points @ moved[:3, :3].T + moved[:3, 3]))
            poses.append(pose @ invert(moved))
            objects.append(label)
    order = rng.permutation(len(scans))
    return [scans[row] for row in order], np.array(poses)[order], np.array(objects)[order]


@pytest.fixture(scope="module")
def scene(bag):
    return register_all(bag[0])


def test_a_bag_of_views_becomes_its_objects(bag, scene):
    scans, poses, objects = bag
    assert sorted(len(part) for part in scene.components) == [3, 3]
    for part in scene.components:
        assert len(set(objects[part])) == 1
        for one, other in itertools.combinations(part, 2):
            true = invert(poses[one]) @ poses[other]
            found = invert(scene.poses[one]) @ scene.poses[other]
            points = scans[other].points[::20]
            away = (points @ (found - true)[:3, :3].T + (found - true)[:3, 3]) ** 2
            assert np.sqrt(away.sum(axis=1)).max() < scene.voxel
    assert scene.tried == 15
    assert (scene.probability > 0.5).all()
    firsts = [part[0] for part in scene.components]
    assert np.array_equal(scene.poses[firsts], np.tile(np.eye(4), (2, 1, 1)))
    assert all(objects[edge.source] == objects[edge.target] for edge in scene.edges if edge.kept)
    assert any("2 scenes of 3, 3 scans" in note for note in scene.notes)


def test_threads_do_not_change_a_bit(bag, scene):
    alone = register_all(bag[0], threads=1)
    assert np.array_equal(alone.poses, scene.poses)
    assert np.array_equal(alone.covariance, scene.covariance)


def test_a_scan_is_added_to_a_scene(bag, scene):
    grown = register_all(bag[0][:-1]).add(bag[0][-1])
    assert [sorted(part) for part in grown.components] == [sorted(part) for part in scene.components]
    assert len(grown.poses) == len(grown.names) == len(grown.scans) == 6
    assert np.abs(grown.poses - scene.poses).max() < 0.1


def test_odometry_links_what_surfaces_do_not_tell(bag):
    scans, _, objects = bag
    one, other = scans[int(np.argmax(objects == 1))], scans[int(np.argmax(objects == 4))]
    assert len(register_all([one, other]).components) == 2
    drive = np.array([np.eye(4), some_pose(np.random.default_rng(1))])
    scene = register_all([one, other], odometry=drive)
    assert scene.components == [[0, 1]]
    assert np.abs(scene.poses[1] - drive[1]).max() < 1.0


def test_what_cannot_be_worked_with_is_left_out(bag, tmp_path):
    scans = list(bag[0])
    empty, missing = tmp_path / "empty.ply", tmp_path / "missing.ply"
    write_cloud(empty, PointCloud(np.zeros((0, 3))))
    large = PointCloud(1000.0 * scans[0].points)
    scene = register_all([*scans, str(empty), str(missing), large])
    assert sorted(len(part) for part in scene.components) == [3, 3]
    assert np.isnan(scene.poses[6:]).all()
    assert np.isnan(scene.probability[6:]).all()
    for name in ("empty.ply", "missing.ply", "scan 8"):
        assert f"{name} is left out: " in " | ".join(scene.notes)


@pytest.mark.parametrize(
    ("given_scans", "options", "message"),
    [
        ([np.zeros((50, 3))], {}, "scans: got 1; give two or more"),
        ([np.zeros((3, 3)), np.zeros((3, 3))], {}, "0 that can be worked with"),
        (None, {"odometry": np.eye(4)}, "odometry"),
        (None, {"pairs": [(0, 9)]}, "there are 6 scans"),
        (None, {"viewpoints": [None]}, "viewpoints"),
    ],
)
def test_bad_input_is_one_sentence(bag, given_scans, options, message):
    with pytest.raises(InputError, match=message) as caught:
        register_all(bag[0] if given_scans is None else given_scans, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("effort", ["normal", "high"])
def test_fine_voxels_are_searched_for_unconnected_scans_with_a_chance(monkeypatch, effort):
    searched = []

    def search_pairs(builder, pairs, depth, proposed=None):
        searched.append((depth, set(pairs)))
        link_pairs(builder, pairs, depth, proposed)

    link_pairs = SceneBuilder._link
    monkeypatch.setattr(SceneBuilder, "_link", search_pairs)
    views = [standin_pair(seed=1, turn=turn, pixels=60) for turn in (40, 80)]
    other = standin_pair(seed=2, pixels=60)
    register_all([views[0].source, views[0].target, views[1].target, other.source], effort=effort)
    every = {(one, two) for one in range(4) for two in range(one)}
    if effort == "high":
        assert searched == [("high", every)]
    else:
        assert searched[0] == ("first", every)
        assert [depth for depth, _ in searched] == ["first", "normal"]
        assert all(3 in pair for pair in searched[1][1])
