"""The voxel chosen by `register`: repeated points, sparse clouds, wide frames; and meshes as surfaces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cgroup import NoConsensusError, register
from cgroup.datasets import standin_pair
from cgroup.features import sample_mesh
from cgroup.io import PointCloud
from cgroup.registration import assess

PAIR = standin_pair(pixels=70)
SOURCE, TARGET, T = PAIR.source.points, PAIR.target.points, PAIR.T_target_source
BOX = np.array([[x, y, z] for x in (0, 60) for y in (0, 40) for z in (0, 8)], dtype=float)
FACES = np.array([
    (0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
    (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3),
])  # fmt: skip


def test_repeated_points_change_nothing() -> None:
    rng = np.random.default_rng(0)
    rows = rng.permutation(np.concatenate([np.arange(len(SOURCE)), rng.integers(0, len(SOURCE), 9000)]))
    once, often = register(SOURCE, TARGET), register(SOURCE[rows], TARGET)
    assert often.ok
    assert often.voxel == pytest.approx(once.voxel, rel=1e-6)
    assert f"9000 of {len(rows)} points repeat others" in " ".join(often.notes)


def test_rows_of_matches_are_those_of_the_points_as_given() -> None:
    matches = np.arange(0, 2 * len(SOURCE), 40)
    twice = np.repeat(SOURCE, 2, axis=0)
    done = register(twice, twice @ T[:3, :3].T + T[:3, 3], matches=(matches, matches))
    assert done.ok
    np.testing.assert_allclose(done.T_target_source, T, atol=0.01)


@pytest.mark.parametrize("count", [300, 600])
def test_a_sparse_cloud_is_registered_on_a_dense_one(count: int) -> None:
    rng = np.random.default_rng(0)
    done = register(SOURCE[rng.permutation(len(SOURCE))[:count]], TARGET)
    np.testing.assert_allclose(done.T_target_source[:3, :3], T[:3, :3], atol=0.05)


@pytest.mark.parametrize("count", [30, 120])
def test_few_points_get_a_verdict(count: int) -> None:
    other = standin_pair(seed=1, pixels=70).target.points
    rng = np.random.default_rng(count)
    with pytest.raises(NoConsensusError):
        register(rng.permutation(SOURCE)[:count], rng.permutation(other)[:count])


def test_a_wide_radius_around_a_rough_pose_is_searched() -> None:
    assert register(SOURCE, TARGET, initial=T, radius=2000.0).ok


def test_samples_depend_on_the_faces_alone() -> None:
    rng = np.random.default_rng(0)
    order, unused = rng.permutation(len(BOX)), [[9.0, 9, 9]]
    mixed = PointCloud(np.concatenate([BOX[order], unused]), faces=np.argsort(order)[rng.permutation(FACES)])
    one, other = (sample_mesh(mesh, spacing=2.0).points for mesh in (PointCloud(BOX, faces=FACES), mixed))
    np.testing.assert_allclose(np.unique(one.round(9), axis=0), np.unique(other.round(9), axis=0))
    area = 2 * (60 * 40 + 60 * 8 + 40 * 8)
    assert area / 4 < len(one) < 2 * area / 4


@given(exponent=st.floats(-12, 0), scale=st.sampled_from([1e-6, 1.0, 1e6]), ratio=st.floats(0, 1))
def test_slivers_get_few_samples(exponent: float, scale: float, ratio: float) -> None:
    corners = scale * np.array([[0.0, 0, 0], [1, 0, 0], [ratio, 10.0**exponent, 0]])
    assert len(sample_mesh(PointCloud(corners, faces=[[0, 1, 2]]))) < 1_100_000


def test_faces_count_in_register_and_assess() -> None:
    small = BOX * (0.4, 0.3, 1.5) + (5, 5, 8)
    tall = BOX * (0.3, 0.2, 3) + (36, 22, 8)
    cad = PointCloud(np.concatenate([BOX, small, tall]), faces=np.concatenate([FACES, FACES + 8, FACES + 16]))
    dense = sample_mesh(cad, spacing=0.7).points
    scan = dense @ T[:3, :3].T + T[:3, 3] + np.random.default_rng(0).normal(0, 0.02, dense.shape)
    done = register(cad, scan)
    np.testing.assert_allclose(done.T_target_source[:3, :3], T[:3, :3], atol=0.01)
    assert assess(cad, scan, T).ok


def _scatter(rng: np.random.Generator, size: float) -> np.ndarray:
    """Flat discs of radius 2, all alike, anywhere in a frame, (40,100,3)."""
    angles, radii = rng.uniform(0, 2 * np.pi, (40, 100)), 2 * np.sqrt(rng.uniform(size=(40, 100)))
    axes = np.linalg.qr(rng.normal(size=(40, 3, 3)))[0]
    discs = radii[..., None] * (
        np.cos(angles)[..., None] * axes[:, :1] + np.sin(angles)[..., None] * axes[:, 1:2]
    )
    return discs + rng.uniform(0, 1, (40, 1, 3)) * np.array((200, 200, 80)) * size


@pytest.mark.parametrize(("size", "seed"), [(2, 0), (10, 3)])
def test_small_parts_in_a_wide_frame_are_registered_by_their_places(size: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    discs = _scatter(rng, size)
    source, target = discs[:32, ::2].reshape(-1, 3), discs[8:, 1::2].reshape(-1, 3)
    done = register(source, target @ T[:3, :3].T + T[:3, 3])
    np.testing.assert_allclose(done.T_target_source[:3, :3], T[:3, :3], atol=0.01)
    with pytest.raises(NoConsensusError):
        register(source, _scatter(rng, size)[:32, 1::2].reshape(-1, 3))
