"""A cloud that is made ready once gives what its array gives, in any order, thread and process."""

import gc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from every_step import steps_of
from numpy.typing import NDArray

from cgroup import features
from cgroup.datasets import standin_pair
from cgroup.io import PointCloud
from cgroup.registration import correspond, describe, detect
from interrupts import assert_holds_in_a_fork, posix_only

POINTS = standin_pair(pixels=80).source.points
PR = features.resolution(POINTS)
NORMALS = features.normals(POINTS)
ROWS = np.arange(0, len(POINTS), 97)


def all_steps(cloud: Any) -> dict[str, Callable[[], Any]]:
    """Every step of a cloud or an array."""
    return steps_of(cloud, NORMALS, unit=PR, rows=ROWS, faces=[[0, 1, 2], [1, 2, 3]]) | {
        "harris3d of a count": lambda: features.harris3d(cloud, count=40),
        "iss of a count": lambda: features.iss(cloud, count=40),
        "shot of a large radius": lambda: features.shot(cloud, NORMALS, ROWS, radius=15 * PR),
    }


EXPECTED = {name: step() for name, step in all_steps(POINTS).items()}


def assert_same(got: NDArray[np.generic] | float, expected: NDArray[np.generic] | float) -> None:
    assert np.asarray(got).dtype == np.asarray(expected).dtype
    np.testing.assert_array_equal(got, expected)


@pytest.mark.parametrize("seed", range(2))
def test_steps_in_any_order_are_those_of_the_array(seed: int) -> None:
    steps = all_steps(features.Cloud(POINTS))
    names = [*steps, *steps]
    np.random.default_rng(seed).shuffle(names)
    for name in names:
        assert_same(steps[name](), EXPECTED[name])


@posix_only
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_process_uses_the_cloud() -> None:
    cloud = features.Cloud(POINTS)
    features.harris3d(cloud)
    steps = all_steps(cloud)
    names = ("harris3d", "shot", "iss")
    assert_holds_in_a_fork(lambda: all(np.array_equal(steps[name](), EXPECTED[name]) for name in names))


def test_float32_is_read_as_it_is() -> None:
    single = POINTS.astype(np.float32)
    cloud = features.Cloud(single)
    assert cloud.points.dtype == np.float32
    assert np.shares_memory(cloud.points, single)
    assert features.resolution(cloud) == features.resolution(single.astype(np.float64))
    described, double = describe(cloud), describe(single.astype(np.float64))
    for name in ("indices", "points", "lrf", "descriptors", "resolution", "centroid"):
        assert_same(getattr(described, name), getattr(double, name))


def test_the_pipeline_takes_clouds() -> None:
    cloud = features.Cloud(POINTS)
    assert_same(detect(cloud), detect(POINTS))
    for options in ({}, {"detector": "iss", "descriptor": "rcs"}, {"keypoints": 40, "descriptor": "lfsh"}):
        by_cloud, by_array = describe(cloud, **options), describe(PointCloud(POINTS), **options)
        assert_same(by_cloud.indices, by_array.indices)
        assert_same(by_cloud.lrf, by_array.lrf)
        assert_same(by_cloud.descriptors, by_array.descriptors)
    assert_same(correspond(cloud, cloud).target, correspond(POINTS, POINTS).target)


def test_a_cloud_is_read_only_and_outlives_its_array() -> None:
    copy = POINTS.copy()
    cloud = features.Cloud(copy)
    assert (len(cloud), repr(cloud)) == (len(POINTS), f"Cloud(n={len(POINTS)})")
    assert cloud.diagonal == pytest.approx(np.linalg.norm(np.ptp(POINTS, axis=0)))
    with pytest.raises(ValueError, match="read-only"):
        cloud.points[0] = 0
    assert copy.flags.writeable
    del copy
    gc.collect()
    assert_same(features.iss(cloud), features.iss(POINTS))
