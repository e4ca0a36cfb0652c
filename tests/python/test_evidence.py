"""Planes, cells, free space and rivals, on shapes made by hand."""

import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cgroup.datasets import standin_pair
from cgroup.registration import assess, prepare, register
from cgroup.registration.evidence import gather
from cgroup.registration.planes import MOST_PLANES, Planes, count_agreeing, find_planes, number_cells
from cgroup.registration.rivals import propose_rivals
from cgroup.rigid import apply, invert
from strategies import random_motion, rigid

PAIR = standin_pair(pixels=80)
EYES = {"source_viewpoint": PAIR.source_viewpoint, "target_viewpoint": PAIR.target_viewpoint}


def walls(count: int, seed: int = 0) -> np.ndarray:
    """Points on so many walls of a room of 40 x 30 x 20, some noise on them."""
    rng = np.random.default_rng(seed)
    sides = [(axis, side) for axis in range(3) for side in (0, 1)][:count]
    points = rng.uniform(0, 1, (count, 400, 3))
    for wall, (axis, side) in zip(points, sides, strict=True):
        wall[:, axis] = side
    return (points * (40, 30, 20)).reshape(-1, 3) + rng.normal(0, 0.02, (400 * count, 3))


@pytest.mark.parametrize("count", [1, 3, 5, 6])
def test_walls_are_found_and_agree_once_each(count: int) -> None:
    points, turn = walls(count), rigid((1, 2, 3), 40)
    turn[:3, 3] = 5, -7, 9
    one, other = find_planes(points, 1.0), find_planes(apply(turn, walls(count, seed=1)), 1.0)
    assert len(one.normals) == count
    assert (one.labels >= 0).mean() > 0.97
    assert count_agreeing(one, other, turn, 1.0) == count
    away = turn.copy()
    away[:3, 3] += turn[:3, 0] * 6  # along x: the walls across it lie on nothing
    assert count_agreeing(one, other, away, 1.0) == count - min(count, 2)


def test_where_nothing_is_flat_there_are_no_planes() -> None:
    ball = np.random.default_rng(0).normal(size=(3000, 3))
    ball *= 30 / np.linalg.norm(ball, axis=1)[:, None]
    assert len(find_planes(ball, 1.0).normals) <= MOST_PLANES
    assert (find_planes(ball, 1.0).labels < 0).mean() > 0.5
    assert len(find_planes(np.arange(30.0)[:, None] * (1, 2, 3), 1.0).normals) == 0


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_cells_off_planes_equal_those_by_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    voxels = rng.uniform(0, 20, size=(80, 3))
    labels = rng.integers(-1, 2, size=80)
    normals = rng.normal(size=(2, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    planes = Planes(normals, rng.uniform(0, 20, size=(2, 3)), [voxels[:5], voxels[5:9]], labels)
    points = rng.uniform(0, 20, size=(60, 3))
    axes = random_motion(rng, 0)[:3, :3]
    cells = number_cells(points, planes, voxels, 1.0, axes)
    for point, cell in zip(points, cells, strict=True):
        beside = [
            abs((point - planes.centers[k]) @ normals[k]) < 1.0
            and (np.linalg.norm(voxels[labels == k] - point, axis=1) <= 2.0).any()
            for k in range(2)
        ]
        assert (cell < 0) == any(beside)
    along = points @ axes.T
    cubes = np.floor((along - along.min(axis=0)) / 4.0)
    for one, other in rng.integers(60, size=(100, 2)):
        if min(cells[one], cells[other]) >= 0:
            assert (cells[one] == cells[other]) == np.array_equal(cubes[one], cubes[other])


def test_evidence_speaks_for_the_true_pose() -> None:
    source, target = (
        prepare(cloud, voxel=3.0, viewpoint=eye)
        for cloud, eye in ((PAIR.source, PAIR.source_viewpoint), (PAIR.target, PAIR.target_viewpoint))
    )
    wrong = PAIR.T_target_source @ rigid((0, 0, 1), 30)
    right, other = (gather(source, target, pose) for pose in (PAIR.T_target_source, wrong))
    assert right.cells > other.cells
    assert right.crossed < 0.01 < other.crossed
    back = gather(target, source, invert(PAIR.T_target_source))
    np.testing.assert_allclose(back, right, rtol=0.02, atol=0.02)
    blind = prepare(PAIR.target, voxel=3.0)
    assert np.isnan(gather(source.turned_by_frames, blind, PAIR.T_target_source).crossed)


def test_rivals_slide_and_turn() -> None:
    points = walls(4)
    scan: Any = SimpleNamespace(
        voxels=SimpleNamespace(points=points), voxel=0.5, normals=np.repeat(np.eye(3), 100, axis=0)
    )
    pose, weak = rigid((0, 0, 1), 20), np.diag([1.0, 1, 1, 9, 1e-3, 9])
    rivals = propose_rivals(scan, scan, pose, weak)
    shifts = rivals[:, :3, 3] - pose[:3, 3]
    slid = np.abs(rivals[:, :3, :3] - pose[:3, :3]).max(axis=(1, 2)) < 1e-12
    assert np.abs(np.diff(np.sort(shifts[slid][:, 1]))).max() <= 10  # both ways along y
    lengths = np.linalg.norm(shifts[slid], axis=1) / scan.voxel
    assert lengths.min() == pytest.approx(10)
    assert lengths.max() == pytest.approx(58)
    turns = rivals[-18:, :3, :3] @ pose[:3, :3].T
    assert {int(np.rint(np.trace(turn))) for turn in turns} == {1, -1}  # quarters and halves
    np.testing.assert_allclose(
        turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (len(turns), 1, 1)), atol=1e-12
    )


def test_rivals_turn_about_the_axis_that_resists_least() -> None:
    """A wheel: turned about its axis by as much as moves its rim by 10 to 58 voxels."""
    around = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    rim = np.stack([np.cos(around), np.sin(around), np.linspace(-0.1, 0.1, 400)], axis=1)
    points, middle = 20 * rim + (100, 50, 0), np.array([100.0, 50, 0])
    normals = np.where(np.arange(400)[:, None] % 2, rim * (1, 1, 0), (0, 0, 1))
    scan: Any = SimpleNamespace(voxels=SimpleNamespace(points=points), voxel=0.5, normals=normals)
    rows = np.hstack([np.cross(points, normals), normals])
    rivals = propose_rivals(scan, scan, np.eye(4), rows.T @ rows)
    about_the_axis = np.abs(rivals @ [*middle, 1] - [*middle, 1]).max(axis=1) < 0.01
    turned = rivals[about_the_axis & (rivals[:, 2, 2] > 0.9999)]
    angles = np.degrees(np.arctan2(turned[:, 1, 0], turned[:, 0, 0]))
    assert len(turned) >= 26
    assert np.abs(angles).min() == pytest.approx(np.degrees(10 * 0.5 / 20), rel=0.05)


def displaced(voxels: float, degrees: float, voxel: float, seed: int) -> np.ndarray:
    """The true pose, moved about the middle of the source."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    change = rigid(tuple(rng.normal(size=3)), degrees)
    middle = apply(PAIR.T_target_source, PAIR.source.points).mean(axis=0)
    change[:3, 3] = middle - change[:3, :3] @ middle + voxels * voxel * direction / np.linalg.norm(direction)
    return change @ PAIR.T_target_source


def test_a_pose_that_is_a_little_off_is_told_from_the_right_one() -> None:
    found = register(PAIR.source, PAIR.target, **EYES)
    right = assess(PAIR.source, PAIR.target, PAIR.T_target_source, **EYES)
    assert right.ok
    np.testing.assert_array_equal(right.T_target_source, PAIR.T_target_source)
    assert right.probability == pytest.approx(found.probability, abs=0.1)
    for seed, (voxels, degrees) in enumerate([(0.6, 0), (1, 1), (4, 0), (0, 5), (2, 3)]):
        told = assess(PAIR.source, PAIR.target, displaced(voxels, degrees, found.voxel, seed), **EYES)
        assert not told.ok
        assert re.search(r"a better pose is \S+ away on average over the source, \S+ voxels", told.notes[0])
        np.testing.assert_allclose(told.alternatives[0], found.T_target_source, atol=0.05 * found.voxel)


def test_a_pose_of_other_clouds_is_refused_with_a_reason() -> None:
    other = standin_pair(seed=3, pixels=80)
    told = assess(PAIR.source, other.target, np.eye(4))
    assert not told.ok
    assert told.notes[0].startswith(("the best pose is right with", "several places", "the surfaces leave"))
