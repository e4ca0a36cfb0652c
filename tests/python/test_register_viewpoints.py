"""What a known viewpoint changes."""

import numpy as np
import pytest
from register_shapes import best_guess
from shared_data import shared_file

from cgroup.datasets import standin_pair
from cgroup.io import read_cloud


def add_speckle(points, rng):
    """Points with 8 of 100 before the surface, as depth cameras see foil."""
    rows = rng.random(len(points)) < 0.08
    moved = points.copy()
    moved[rows] *= rng.uniform(0.85, 0.97, (rows.sum(), 1))
    return moved


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_viewpoint_refuses_no_pose_that_is_accepted_without_it(seed):
    pair, rng = standin_pair(seed=seed, turn=90, pixels=70), np.random.default_rng(seed)
    source, target = (add_speckle(cloud.points, rng) for cloud in (pair.source, pair.target))
    blind = best_guess(source, target)
    seen = best_guess(source, target, viewpoint=(0, 0, 0))
    assert seen.ok or not blind.ok
    if blind.ok:
        off = np.linalg.inv(pair.T_target_source) @ seen.T_target_source
        assert np.trace(off[:3, :3]) > 1 + 2 * np.cos(np.radians(5))


@pytest.mark.parametrize("row", ["10", "12"])
def test_a_viewpoint_keeps_the_best_pose_of_a_speckled_sensor(row):
    source, target = (
        read_cloud(shared_file(f"data/scenes/apc_box_f200_13/scan_0{each}.ply")).points
        for each in ("00", row)
    )
    blind = best_guess(source, target)
    seen = best_guess(source, target, viewpoint=(0, 0, 0))
    off = np.linalg.inv(blind.T_target_source) @ seen.T_target_source
    assert np.trace(off[:3, :3]) > 1 + 2 * np.cos(np.radians(5))
    assert seen.probability >= blind.probability
