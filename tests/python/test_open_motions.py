"""Motions that surfaces leave open: planes, pipes, balls and rings, but no shallow relief, whatever the noise."""

from collections.abc import Callable

import numpy as np
import pytest
from register_shapes import FloatArray, cylinder, moved, plane, relief, sphere, torus

from cgroup.errors import NoConsensusError
from cgroup.registration import register, register_many
from cgroup.rigid import apply


def add_outliers(points: FloatArray, seed: int) -> FloatArray:
    low, high = points.min(axis=0) - 5, points.max(axis=0) + 5
    outliers = np.random.default_rng(seed).uniform(low, high, size=(len(points) * 15 // 100, 3))
    return np.concatenate([points, outliers])


@pytest.mark.parametrize(("rms", "noise"), [(0.15, 0.002), (0.25, 0.02), (0.5, 0.05), (1.0, 0.2)])
def test_a_shallow_relief_fixes_the_pose(rms: float, noise: float) -> None:
    source = relief(0, rms, noise)
    target, truth = moved(relief(1, rms, noise), 7, 50)
    done = register(source, target)
    assert done.open_motion is None
    off = np.linalg.norm(apply(done.T_target_source, source) - apply(truth, source), axis=1).mean()
    assert off < 0.5 * done.voxel  # refining goes slowly where little resists


def test_outliers_do_not_open_motions() -> None:
    source, flat = relief(0, 1.0, 0.02), plane(0)
    target, truth = moved(add_outliers(relief(1, 1.0, 0.02), 2), 7, 50)
    done = register(add_outliers(source, 1), target)
    assert np.abs(apply(done.T_target_source, source) - apply(truth, source)).max() < 0.25 * done.voxel
    with pytest.raises(NoConsensusError):
        register(add_outliers(100 * flat, 1), add_outliers(100 * plane(1), 2))


@pytest.mark.parametrize(("rms", "noise"), [(0, 0), (0, 0.02), (0, 0.1), (0, 0.4), (0.02, 0.1), (0.02, 0.4)])
def test_noise_on_flat_ground_fixes_no_pose(rms: float, noise: float) -> None:
    source, target = relief(2, rms, noise), moved(relief(3, rms, noise), 7, 50)[0]
    with pytest.raises(NoConsensusError) as caught:
        register(source, target)
    if noise < 0.1:  # normals of more noise resist as slopes do
        best = caught.value.registration
        assert best is not None
        assert "free to move in 3 of six ways" in best.notes[0]
        assert best.open_motion is not None


@pytest.mark.parametrize("noise", [0.0, 0.002])
@pytest.mark.parametrize("shape", [sphere, cylinder, torus])
def test_round_shapes_leave_motions_open(shape: Callable[[int], FloatArray], noise: float) -> None:
    """Noise may hold a motion: of one pair in some twenty none is open."""
    rng = np.random.default_rng(5)
    clouds = [shape(seed) for seed in range(6)]
    clouds = [cloud + noise * rng.normal(size=cloud.shape) for cloud in clouds]
    found = register_many(clouds, [(0, 1), (2, 3), (4, 5)])
    assert not any(done.ok for done in found)
    assert sum(done.open_motion is not None for done in found) >= 2
