"""The generated pair: reproducible, partial, noisy, and posed as it says."""

import numpy as np
import pytest

from cgroup import features
from cgroup.datasets import standin_pair
from cgroup.errors import InputError
from cgroup.evaluation import overlap, within
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN
from cgroup.rigid import check_rigid

SMALL = 60  # pixels


def spacing(points: np.ndarray) -> float:
    """Median distance of neighbouring pixels along the first axis of the grid."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return float(np.median(steps))


def test_same_seed_same_pair() -> None:
    first, second, other = (standin_pair(seed=seed, pixels=SMALL) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.source.points, second.source.points)
    np.testing.assert_array_equal(first.target.points, second.target.points)
    np.testing.assert_array_equal(first.T_target_source, second.T_target_source)
    assert len(other.source) != len(first.source) or (other.source.points != first.source.points).any()


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_pose_lays_the_views_on_each_other(seed: int) -> None:
    pair = standin_pair(seed=seed, noise=0, pixels=SMALL)
    pose = check_rigid(pair.T_target_source)
    moved = pair.source.transformed(pose).points
    step = spacing(pair.target.points)
    near = within(moved, pair.target.points, 1.5 * step)
    assert 0.4 < near.mean() < 0.95
    wrong = pose.copy()
    wrong[:3, 3] += 4 * step
    assert within(pair.source.transformed(wrong).points, pair.target.points, step).mean() < 0.5 * near.mean()


def test_demo_pair_is_partial() -> None:
    pair = standin_pair()
    pr = features.resolution(pair.source.points)
    share = overlap(
        pair.source.points, pair.target.points, pair.T_target_source, tolerance=OVERLAP_WITHIN * pr
    )
    assert 0.6 < share < 0.97
    for cloud in (pair.source, pair.target):
        assert 9_000 < len(cloud) < 25_000
        assert (cloud.points[:, 2] < 0).all()  # the scanner looks along -z


def test_noise_is_along_the_line_of_sight() -> None:
    clean, noisy = (standin_pair(noise=noise, pixels=SMALL).source.points for noise in (0, 0.5))
    assert len(clean) == len(noisy)
    directions = clean / np.linalg.norm(clean, axis=1, keepdims=True)
    np.testing.assert_allclose(np.cross(noisy, directions), 0, atol=1e-9)
    deviation = np.linalg.norm(noisy - clean, axis=1).std()
    assert 0 < deviation < spacing(clean)


@pytest.mark.parametrize(
    "arguments",
    [{"turn": -1}, {"turn": float("nan")}, {"noise": -0.1}, {"noise": float("inf")}, {"pixels": 3}],
)
def test_bad_arguments(arguments: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(arguments))):
        standin_pair(**arguments)  # pyright: ignore[reportArgumentType]
