"""Locked axes of a pose, and parts of a cloud."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_lines import fail, succeed
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from cgroup.datasets import standin_pair
from cgroup.errors import InputError, NoConsensusError
from cgroup.evaluation import rotation_error
from cgroup.io import read_cloud, write_cloud
from cgroup.registration import Registration, register
from cgroup.rigid import apply, invert
from cgroup.rigid.locks import AXES, as_locks
from cgroup.rigid.se3 import motion
from cgroup.types import PointCloud

Floats = NDArray[np.float64]
LEVELLED = "yaw,x,y,z"
FREE = [
    "yaw,x,y,z",
    "roll,x,y,z",
    "pitch, x",
    "yaw,x,y",
    "x,y,z",
    "z",
    "roll,pitch,yaw",
    "roll,pitch,yaw,x,y",
]
ORIGIN = np.zeros(3)


def draw_locked(free: str, rng: np.random.Generator, start: Floats | None = None) -> Floats:
    """A pose with the locked values of another, or zero."""
    names = {name.strip() for name in free.split(",")}
    vector = np.array([axis in names for axis in AXES]) * rng.uniform(-3, 3, 6)
    if {"roll", "pitch", "yaw"} <= names:
        vector[:3] *= 0.5
    pose = motion(vector, ORIGIN)
    if start is None:
        return pose
    moved = pose @ start
    moved[:3, 3] = start[:3, 3] + vector[3:]
    return moved


@given(free=st.sampled_from(FREE), seed=st.integers(0, 2**32 - 1), is_from_pose=st.booleans())
def test_the_locked_pose_is_the_likeliest_one(free: str, seed: int, *, is_from_pose: bool) -> None:
    rng = np.random.default_rng(seed)
    start = motion(rng.normal(size=6), ORIGIN) if is_from_pose else None
    truth = draw_locked(free, rng, start)
    locks = as_locks(free, start)
    assert locks is not None
    root = 1e-5 * rng.normal(size=(6, 6))  # small: the square of a rotation is neglected
    covariance = root @ root.T
    found = motion(rng.multivariate_normal(np.zeros(6), covariance), ORIGIN) @ truth
    pose, left = locks.condition(found, covariance)
    np.testing.assert_allclose(locks.excess(pose), 0, atol=1e-12)
    assert np.linalg.eigvalsh(covariance - left).min() > -1e-15
    # Any other pose with the locked values is less likely.
    weight = np.linalg.inv(covariance)

    def distance(other: Floats) -> float:
        turn = other[:3, :3] @ found[:3, :3].T
        vector = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
        change = np.concatenate([vector, other[:3, 3] - turn @ found[:3, 3]])
        return float(change @ weight @ change)

    names = {name.strip() for name in free.split(",")}
    freedom = np.array([axis in names for axis in AXES], dtype=float)
    for _ in range(10):
        step = 1e-5 * freedom * rng.normal(size=6)
        other = motion(step, pose[:3, 3]) @ pose
        assert distance(other) > distance(pose) - 1e-3 * (1 + distance(pose))


def levelled_pair(seed: int, tilt: float = 0.0) -> tuple[Floats, Floats, Floats]:
    """Noisy views of a shape in level frames, but for a tilt in degrees, and the pose."""
    rng, pair = np.random.default_rng(seed), standin_pair(seed=seed, pixels=60)
    pose = draw_locked(LEVELLED, rng)
    pose[:3, 3] *= 20
    wrong = motion(np.array([np.radians(tilt), 0, 0, 0, 0, 0]), ORIGIN)
    placed = apply(wrong @ invert(pose) @ pair.T_target_source, pair.source.points)
    clouds = (placed, pair.target.points)
    source, target = (points + rng.normal(0, 0.3, points.shape) for points in clouds)
    return source, target, pose @ invert(wrong)


def middle_error(done: Registration, truth: Floats, source: Floats) -> float:
    middle = source.mean(axis=0)[None]
    return float(np.linalg.norm(apply(done.T_target_source, middle) - apply(truth, middle)))


def test_levelled_scans_are_registered_more_precisely() -> None:
    errors: dict[str | None, list[float]] = {None: [], LEVELLED: []}
    for seed in range(8):
        source, target, truth = levelled_pair(seed)
        for free, found in errors.items():
            done = register(source, target, free=free)
            found.append(rotation_error(done.T_target_source, truth))
            if free is not None:
                np.testing.assert_allclose(done.T_target_source[2, :3], [0, 0, 1], atol=1e-12)
                turned = np.diagonal(done.covariance)[:2]
                np.testing.assert_allclose(turned, 0, atol=1e-15)
                assert np.isfinite(done.deviations).all()
                assert middle_error(done, truth, source) < 0.1 * done.voxel
    assert np.mean(errors[LEVELLED]) < np.mean(errors[None])


def test_surfaces_that_contradict_the_locks_are_refused() -> None:
    source, target, truth = levelled_pair(1, tilt=5.0)
    assert rotation_error(register(source, target).T_target_source, truth) < 1
    with pytest.raises(NoConsensusError, match=r"degrees off the locked axes; leave out `free`"):
        register(source, target, free=LEVELLED)


def test_locked_values_are_those_of_a_rough_pose() -> None:
    pair = standin_pair(pixels=60)
    rough = motion(np.radians([0, 0, 3.0, 0, 0, 0]), pair.T_target_source[:3, 3]) @ pair.T_target_source
    done = register(pair.source, pair.target, initial=rough, free="yaw")
    np.testing.assert_array_equal(done.T_target_source[:3, 3], rough[:3, 3])
    assert rotation_error(done.T_target_source, pair.T_target_source) < 0.5


@pytest.mark.parametrize("free", ["", "yaw;x", "yaw,roll", "heading", 4, ["yaw"]])
def test_wrong_names_of_axes_are_refused(free: Any) -> None:
    pair = standin_pair(pixels=60)
    with pytest.raises(InputError, match=r"^free: got .*; give names of roll, pitch, yaw, x, y, z"):
        register(pair.source, pair.target, free=free)


def test_locked_axes_and_a_scale_exclude_each_other() -> None:
    pair = standin_pair(pixels=60)
    with pytest.raises(InputError, match="leave out `free`"):
        register(pair.source, pair.target, free=LEVELLED, scale=True)


@given(seed=st.integers(0, 2**32 - 1), is_mesh=st.booleans(), is_bare=st.booleans())
def test_a_part_keeps_the_attributes_of_its_points(seed: int, *, is_mesh: bool, is_bare: bool) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(0, 30))
    points = rng.integers(0, 4, (count, 3)).astype(float)
    faces = rng.integers(0, count, (20, 3)) if is_mesh and count else None
    others = (None, None) if is_bare else (rng.normal(size=(count, 3)), rng.integers(0, 255, (count, 3)))
    colors = None if others[1] is None else others[1].astype(np.uint8)
    cloud = PointCloud(points, others[0], faces, colors, viewpoint=np.ones(3))
    low, high = np.sort(rng.integers(0, 4, (2, 3)), axis=0)
    high = np.where(rng.random(3) < 0.3, np.inf, high)
    rows = [all(a <= x <= b for a, x, b in zip(low, point, high, strict=True)) for point in points]
    mask, inside = np.array(rows, dtype=bool), cloud.crop(low, high)
    np.testing.assert_array_equal(inside.points, points[mask])
    for name in ("normals", "colors"):
        whole, kept = getattr(cloud, name), getattr(inside, name)
        assert kept is None if whole is None else np.array_equal(kept, whole[mask])
    if faces is not None:
        assert inside.faces is not None
        expected = points[faces[mask[faces].all(axis=1)]]
        np.testing.assert_array_equal(inside.points[inside.faces], expected)
    assert inside.viewpoint is not None


def test_wrong_parts_are_refused() -> None:
    cloud = PointCloud(np.eye(3))
    for call in (
        lambda: cloud.select([True]),
        lambda: cloud.select([0, 1, 2]),
        lambda: cloud.crop([0, 0], [1, 1, 1]),
        lambda: cloud.crop([0, 0, 2], [1, 1, 1]),
        lambda: cloud.crop([0, 0, np.nan], [1, 1, 1]),
    ):
        with pytest.raises(InputError):
            call()


def test_the_command_registers_a_part_and_writes_the_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pair = standin_pair(pixels=60)
    clutter = pair.source.points[:2_000] * 0.5 + [0, 0, 300]
    whole = np.concatenate([pair.source.points, clutter])
    write_cloud(tmp_path / "a.ply", PointCloud(whole))
    write_cloud(tmp_path / "b.ply", pair.target)
    names = [str(tmp_path / name) for name in ("a.ply", "b.ply")]
    box = [*(["-inf"] * 3), "inf", "inf", "0"]
    arguments = ["register", *names, "--out", tmp_path / "out"]
    document = json.loads(succeed(capsys, *arguments, "--json", "--source-crop", *box))
    source, target = (read_cloud(name) for name in names)
    alone = register(source.crop([-np.inf] * 3, [np.inf, np.inf, 0]), target)
    assert np.array_equal(document["results"]["T_target_source"], alone.T_target_source)
    assert len(read_cloud(tmp_path / "out" / "a_on_b_aligned.ply")) == len(whole)
    assert "--source-crop: got (900.0" in fail(capsys, *arguments, "--source-crop", *(["900"] * 6))
    assert "--free: got 'yaw,roll'" in fail(capsys, *arguments, "--free", "yaw,roll")
