"""The surface between the rings of few beams is filled in, and other clouds are left alone."""

from __future__ import annotations

import numpy as np
import pytest

from cgroup.datasets import standin_pair
from cgroup.registration.rings import Rings, fill_between_rings, find_rings
from cgroup.registration.scan import as_scan
from cgroup.rigid import apply
from cgroup.types import PointCloud
from strategies import random_motion

ROOM = np.array([4.0, 3.0, 1.4])
"""Half the sides of a room, with the scanner in its middle."""


def spin(
    beams: int, columns: int = 600, noise: float = 0.0, place: tuple[float, ...] = (0, 0, 0)
) -> np.ndarray:
    """Scan the room from a place in it, relative to that place."""
    up, around = np.radians(np.linspace(-30, 30, beams)), np.linspace(0, 2 * np.pi, columns, False)
    u, a = (each.reshape(-1) for each in np.meshgrid(up, around, indexing="ij"))
    rays = np.stack([np.cos(u) * np.cos(a), np.cos(u) * np.sin(a), np.sin(u)], axis=1)
    walls = np.where(rays > 0, ROOM - np.array(place), ROOM + np.array(place))
    ranges = (walls / np.maximum(np.abs(rays), 1e-9)).min(axis=1)
    return rays * (ranges + noise * np.random.default_rng(0).normal(size=len(rays)))[:, None]


def rings_of(points: np.ndarray) -> Rings | None:
    return find_rings(points, as_scan("source", points).axes)


@pytest.mark.parametrize("beams", [8, 16, 32])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_rings_are_told_wherever_the_scanner_stands(beams: int, noise: float) -> None:
    rng = np.random.default_rng(beams)
    points = spin(beams, noise=noise, place=tuple(rng.uniform(-0.7, 0.7, size=3) * ROOM))
    order = rng.permutation(len(points))
    rings = rings_of(apply(random_motion(rng, 20.0), points)[order])
    assert rings is not None
    labels = np.empty(len(points), dtype=int)
    labels[order] = rings.labels
    labels = labels.reshape(beams, -1)
    assert (labels == labels[:, :1]).all()
    assert sorted(labels[:, 0]) == list(range(beams))
    np.testing.assert_allclose(rings.ranges, np.linalg.norm(points, axis=1)[order], atol=0.02)


def test_what_is_filled_in_lies_on_the_walls() -> None:
    points = spin(16)
    filled = fill_between_rings(as_scan("source", points)).cloud.points
    np.testing.assert_array_equal(filled[: len(points)], points)
    assert len(filled) > 3 * len(points)
    depth = np.abs(np.abs(filled) - ROOM).min(axis=1)  # from the nearest wall
    assert (depth < 1e-9).mean() > 0.85
    assert depth.max() < 0.6  # across an edge of the room


def test_rings_of_two_surfaces_are_not_joined() -> None:
    points = spin(16)
    above = points[:, 2] > 0
    points[above] *= 4  # as if a wall stood behind a parapet
    filled = fill_between_rings(as_scan("source", points)).cloud.points
    sizes = np.abs(filled / ROOM).max(axis=1)
    assert ((sizes < 1.01) | (sizes > 3.5)).mean() > 0.97


@pytest.mark.parametrize(
    "cloud",
    [
        standin_pair(pixels=60).source.points,
        spin(64),
        spin(150, 200),
        np.random.default_rng(0).normal(size=(900, 3)),
        PointCloud(spin(16), normals=np.ones((16 * 600, 3))),
    ],
    ids=["depth image", "64 beams", "station", "ball", "with normals"],
)
def test_other_clouds_are_left_alone(cloud: np.ndarray | PointCloud) -> None:
    scan = as_scan("source", cloud)
    assert fill_between_rings(scan) is scan


def test_few_points_have_no_rings() -> None:
    for points in (np.eye(3), np.zeros((30, 3)), np.ones((30, 1)) * np.arange(3.0)):
        assert find_rings(points, np.eye(3)) is None
