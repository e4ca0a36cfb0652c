"""What a known viewpoint changes."""

import numpy as np
import pytest

from cgroup.datasets import standin_pair
from cgroup.errors import NoConsensusError
from cgroup.registration import register


def register_or_refuse(source, target, **options):
    try:
        return register(source, target, **options)
    except NoConsensusError as error:
        return error.registration


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
    blind = register_or_refuse(source, target)
    seen = register_or_refuse(source, target, viewpoint=(0, 0, 0))
    assert seen.ok or not blind.ok
    if blind.ok:
        off = np.linalg.inv(pair.T_target_source) @ seen.T_target_source
        assert np.trace(off[:3, :3]) > 1 + 2 * np.cos(np.radians(5))
