"""Two files of Gaussian splats: aligned with unknown scale, moved, and seen in the same colours."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("plyfile", reason="pip install plyfile")

from colmap_files import pose_of
from plyfile import PlyData, PlyElement
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from cgroup.datasets import standin_pair
from cgroup.io import read_cloud, transform_file
from cgroup.registration import register
from cgroup.rigid import apply, invert, rotation_error
from cgroup.rigid.transforms import split_scale

SCALE = 2.5
POSE = pose_of(np.array([0.3, -1.0, 2.0]), np.array([4.0, -7.0, 3.0]))
NAMES = [*"xyz", *(f"f_dc_{i}" for i in range(3)), *(f"f_rest_{i}" for i in range(45)), "opacity"]
NAMES += [*(f"scale_{i}" for i in range(3)), *(f"rot_{i}" for i in range(4))]


def write_splats(path: Path, points: np.ndarray) -> np.ndarray:
    rng = np.random.default_rng(len(points))
    rows = np.zeros(len(points), [(name, "f4") for name in NAMES])
    for name in NAMES[3:]:
        rows[name] = rng.normal(scale=0.3, size=len(points))
    for axis, name in enumerate("xyz"):
        rows[name] = points[:, axis]
    rows["opacity"] = rng.uniform(0, 4, len(points))
    PlyData([PlyElement.describe(rows, "vertex")]).write(path)
    return rows


def basis(directions: np.ndarray) -> np.ndarray:
    """Return the real harmonics (n,16) in the order and with the signs of 3D Gaussian splatting.

    By SciPy's complex harmonics with the Condon-Shortley phase, which the published constants have as well.
    """
    polar, azimuth = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    columns = []
    for degree in range(4):
        for order in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(order), polar, azimuth)
            part = value.real if order == 0 else np.sqrt(2) * (value.imag if order < 0 else value.real)
            columns.append(part)
    return np.stack(columns, axis=1)


def colours(rows: np.ndarray, directions: np.ndarray) -> np.ndarray:
    table = basis(directions)
    result = []
    for channel in range(3):
        names = [f"f_dc_{channel}", *(f"f_rest_{15 * channel + i}" for i in range(15))]
        result.append((np.stack([rows[name].astype(float) for name in names], axis=1) * table).sum(axis=1))
    return np.stack(result, axis=1)


def covariances(rows: np.ndarray) -> np.ndarray:
    turns = Rotation.from_quat(np.stack([rows[f"rot_{i}"] for i in (1, 2, 3, 0)], axis=1)).as_matrix()
    sizes = np.exp(np.stack([rows[f"scale_{i}"] for i in range(3)], axis=1).astype(float))
    return turns @ (sizes[:, :, None] ** 2 * turns.transpose(0, 2, 1))


def test_the_basis_is_that_of_gaussian_splatting() -> None:
    x, y, z = d = np.array([0.36, 0.48, 0.8])
    published = {1: -0.4886025119 * y, 2: 0.4886025119 * z, 3: -0.4886025119 * x, 4: 1.0925484306 * x * y,
                 7: -1.0925484306 * x * z, 8: 0.5462742153 * (x * x - y * y), 10: 2.8906114426 * x * y * z,
                 15: -0.5900435899 * x * (x * x - 3 * y * y)}  # fmt: skip
    found = basis(d[None])[0]
    for column, value in published.items():
        assert found[column] == pytest.approx(value, abs=1e-9), column


def test_moved_splats_look_the_same(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    before = write_splats(tmp_path / "one.ply", rng.normal(size=(500, 3)))
    assert transform_file(tmp_path / "one.ply", POSE, tmp_path / "moved.ply", scale=SCALE) == []
    after = PlyData.read(tmp_path / "moved.ply")["vertex"].data
    directions = rng.normal(size=(500, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    turn = POSE[:3, :3]
    np.testing.assert_allclose(colours(after, directions @ turn.T), colours(before, directions), atol=1e-5)
    expected = SCALE**2 * turn @ covariances(before) @ turn.T
    np.testing.assert_allclose(covariances(after), expected, rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(after["opacity"], before["opacity"])


def test_two_files_are_aligned(tmp_path: Path) -> None:
    pair = standin_pair(seed=1, pixels=100)
    write_splats(tmp_path / "first.ply", apply(POSE, pair.source.points / SCALE))
    write_splats(tmp_path / "second.ply", pair.target.points)
    first, second = read_cloud(tmp_path / "first.ply"), read_cloud(tmp_path / "second.ply")
    done = register(first, second, scale=True)
    pose = done.T_target_source.copy()
    pose[:3, :3] /= done.scale
    assert done.scale == pytest.approx(SCALE, rel=5e-3)
    truth = pair.T_target_source @ np.diag([SCALE, SCALE, SCALE, 1]) @ invert(POSE)
    assert rotation_error(pose, split_scale(truth)[1]) < 0.2
    transform_file(tmp_path / "first.ply", pose, tmp_path / "moved.ply", scale=done.scale)
    moved = read_cloud(tmp_path / "moved.ply").points
    np.testing.assert_allclose(moved, done.place(first).points, atol=1e-5 * np.ptp(moved))
