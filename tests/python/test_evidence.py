"""Poses that are given: right, a little off, of other clouds."""

import re

import numpy as np
import pytest

from cgroup.datasets import standin_pair
from cgroup.registration import assess, register
from cgroup.rigid import apply
from strategies import rigid

PAIR = standin_pair(pixels=80)
EYES = {"source_viewpoint": PAIR.source_viewpoint, "target_viewpoint": PAIR.target_viewpoint}


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
