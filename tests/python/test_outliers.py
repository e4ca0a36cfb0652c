"""Clouds as scanners leave them: outliers, points far away, and any unit."""

import numpy as np
import pytest

from cgroup.datasets import standin_pair
from cgroup.fronts.scan import as_scan, without_outliers
from cgroup.registration import PreparedScan, prepare, register
from cgroup.rigid import apply
from reference.outliers import find_outliers

PAIR = standin_pair(pixels=80)
SOURCE, TARGET = PAIR.source.points, PAIR.target.points


def scattered(points: np.ndarray, share: float, size: float, seed: int = 0) -> np.ndarray:
    """Points with so many more, relative to them, spread over so many times their extent."""
    count = round(share * len(points))
    extent = np.ptp(points, axis=0).max()
    outliers = size * extent * (np.random.default_rng(seed).random((count, 3)) - 0.5)
    return np.concatenate([points, points.mean(axis=0) + outliers])


def far(points: np.ndarray) -> np.ndarray:
    return np.concatenate([points, [[1e6 * np.ptp(points), 0, 0]]])


@pytest.mark.parametrize(
    ("source", "target", "told"),
    [
        (scattered(SOURCE, 0.01, 10), TARGET, "source: "),
        (far(SOURCE), far(TARGET), "one point far from all others set aside"),
        (far(scattered(SOURCE, 0.02, 30)), TARGET, "source: "),
    ],
)
def test_outliers_are_set_aside_and_counted(source: np.ndarray, target: np.ndarray, told: str) -> None:
    found = register(source, target)
    moved = apply(found.T_target_source, SOURCE) - apply(PAIR.T_target_source, SOURCE)
    assert np.abs(moved).max() < found.voxel
    assert any(told in note and "set aside" in note for note in found.notes)


@pytest.mark.parametrize("count", [1, 40])
def test_outliers_are_counted_exactly(count: int) -> None:
    rng = np.random.default_rng(count)
    directions = rng.normal(size=(count, 3))
    away = directions / np.linalg.norm(directions, axis=1)[:, None] * 1e4 * rng.uniform(1, 9, (count, 1))
    rows = rng.permutation(len(SOURCE) + count)
    scan = prepare(np.concatenate([SOURCE, away])[rows], voxel=4.0).scan
    assert scan.outliers == count
    assert {tuple(row) for row in np.asarray(scan.cloud.points)} == {tuple(row) for row in SOURCE}


def test_outliers_are_those_of_the_reference() -> None:
    rng = np.random.default_rng(0)
    for share in (0.002, 0.01, 0.04):
        points = scattered(SOURCE, share, 12)
        points = np.concatenate([points, points[-1] + rng.normal(size=(5, 3))])
        left = prepare(points, voxel=4.0).scan.cloud.points
        expected = np.delete(points, find_outliers(points), axis=0)
        np.testing.assert_array_equal(left, expected)


@pytest.mark.parametrize(
    "points",
    [
        np.concatenate([SOURCE, SOURCE[::3] + np.array([5000.0, 0, 0])]),  # another surface
        scattered(SOURCE, 0.1, 1000),  # too many
        SOURCE,
    ],
    ids=["surface", "many", "none"],
)
def test_other_points_far_away_are_no_outliers(points: np.ndarray) -> None:
    assert without_outliers(as_scan("source", points)).outliers == 0


def test_a_small_cloud_gets_enough_voxels_beside_a_huge_one() -> None:
    rng = np.random.default_rng(0)
    floor = np.c_[rng.uniform(-500, 500, (200_000, 2)), rng.normal(0, 0.1, 200_000)] + TARGET.mean(axis=0)
    found = register(SOURCE, np.concatenate([TARGET, floor]))
    assert found.ok
    source = prepare(SOURCE, voxel=found.voxel)
    assert isinstance(source, PreparedScan)
    assert len(source) >= 500
