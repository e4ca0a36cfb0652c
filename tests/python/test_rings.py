"""The surface between the rings of few beams is filled in, and other clouds are left alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cgroup.datasets import standin_pair
from cgroup.features import within
from cgroup.registration import prepare
from cgroup.rigid import apply
from cgroup.types import PointCloud
from reference.rings import fill_between_rings
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


def filled(cloud: np.ndarray | PointCloud) -> np.ndarray:
    """Return the points of a prepared scan."""
    normals = "given" if isinstance(cloud, PointCloud) else "pca"
    return np.asarray(prepare(cloud, normals=normals).scan.cloud.points)


@pytest.mark.parametrize("beams", [8, 16, 32])
@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_rings_are_filled_in_wherever_the_scanner_stands(beams: int, noise: float) -> None:
    rng = np.random.default_rng(beams)
    points = spin(beams, noise=noise, place=tuple(rng.uniform(-0.7, 0.7, size=3) * ROOM))
    expected = fill_between_rings(points.reshape(beams, -1, 3))
    order, motion = rng.permutation(len(points)), random_motion(rng, 20.0)
    found = filled(apply(motion, points)[order])[len(points) :]
    near = within(apply(np.linalg.inv(motion), found), expected, 1e-4)
    assert abs(len(found) - len(expected)) <= 0.01 * len(expected)
    assert near.mean() > 0.98  # but for lines to the other of two points as near in angle


@given(seed=st.integers(0, 2**32 - 1), beams=st.sampled_from([12, 16, 24, 32]))
def test_the_scanner_of_rings_is_known(seed: int, beams: int) -> None:
    rng = np.random.default_rng(seed)
    points = spin(beams, noise=0.01, place=tuple(rng.uniform(-0.7, 0.7, size=3) * ROOM))
    motion = random_motion(rng, 20.0)
    done = prepare(apply(motion, points))
    assert done.viewpoint is not None
    np.testing.assert_allclose(done.viewpoint, motion[:3, 3], atol=0.02)
    assert prepare(apply(motion, points), viewpoint=(50, 0, 0)).viewpoint == (
        50.0,
        0.0,
        0.0,
    )  # a given one wins


def test_what_is_filled_in_lies_on_the_walls() -> None:
    points = spin(16)
    found = filled(points)
    np.testing.assert_array_equal(found[: len(points)], points)
    assert len(found) > 3 * len(points)
    depth = np.abs(np.abs(found) - ROOM).min(axis=1)  # from the nearest wall
    assert (depth < 1e-9).mean() > 0.85
    assert depth.max() < 0.6  # across an edge of the room


def test_rings_of_two_surfaces_are_not_joined() -> None:
    points = spin(16)
    above = points[:, 2] > 0
    points[above] *= 4  # as if a wall stood behind a parapet
    sizes = np.abs(filled(points) / ROOM).max(axis=1)
    assert ((sizes < 1.01) | (sizes > 3.5)).mean() > 0.97


@pytest.mark.parametrize("deviation", [0.0001, 0.0005])
def test_rings_are_found_though_elevations_vary(deviation: float) -> None:
    """As those of a scanner that moves, or of coarse angles."""
    points = spin(16, noise=0.01, place=(1.0, -0.5, 0.2))
    rng = np.random.default_rng(1)
    across = np.cross(points, [0, 0, 1.0])
    points += (
        deviation
        * rng.normal(size=(len(points), 1))
        * np.cross(across, points)
        / np.linalg.norm(across, axis=1)[:, None]
    )
    assert len(filled(points)) > 3 * len(points)


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
    points = cloud.points if isinstance(cloud, PointCloud) else cloud
    assert len(filled(cloud)) == len(points)
