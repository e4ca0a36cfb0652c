"""Meshes made finer along their curvature: on a sphere, on a plane, at borders and without normals."""

import numpy as np
import pytest

from cgroup import features
from cgroup.datasets.subdivision import Surface, longest_edges, subdivide

OCTAHEDRON = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
SIDES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])


def without_normals(surface: Surface) -> Surface:
    return surface._replace(normals=np.full_like(surface.points, np.nan))


@pytest.fixture(scope="module")
def sphere() -> Surface:
    """72 triangles with corners on the unit sphere."""
    flat = subdivide(without_normals(Surface(OCTAHEDRON, SIDES, OCTAHEDRON)), 3)
    points = flat.points / np.linalg.norm(flat.points, axis=1, keepdims=True)
    return Surface(points, flat.faces, points)


def times_used(faces: np.ndarray) -> np.ndarray:
    """How many triangles each edge has."""
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    return np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)[1]


def volume(surface: Surface) -> float:
    a, b, c = surface.points[surface.faces].transpose(1, 0, 2)
    return float(np.einsum("fx,fx->", np.cross(a, b), c) / 6)


@pytest.mark.parametrize("parts", [2, 3, 5])
def test_new_points_lie_close_to_the_sphere(sphere: Surface, parts: int) -> None:
    curved, flat = subdivide(sphere, parts), subdivide(without_normals(sphere), parts)
    off_curved, off_flat = (np.abs(np.linalg.norm(each.points, axis=1) - 1).max() for each in (curved, flat))
    assert off_curved < 0.15 * off_flat
    np.testing.assert_array_equal(curved.points[: len(sphere.points)], sphere.points)
    assert volume(flat) < volume(curved) < 4 / 3 * np.pi


def test_normals_follow_the_sphere(sphere: Surface) -> None:
    fine = subdivide(sphere, 5)
    np.testing.assert_allclose(np.linalg.norm(fine.normals, axis=1), 1)
    true = fine.points / np.linalg.norm(fine.points, axis=1, keepdims=True)
    angles = np.degrees(np.arccos(np.minimum(1, np.sum(fine.normals * true, axis=1))))
    assert angles.max() < 0.3
    np.testing.assert_array_equal(fine.normals[: len(sphere.points)], sphere.points)


@pytest.mark.parametrize("parts", [1, 2, 3, 4, 7])
def test_mesh_is_whole(sphere: Surface, parts: int) -> None:
    fine = subdivide(sphere, parts)
    assert len(fine.faces) == parts**2 * len(sphere.faces)
    assert parts > 1 or all(map(np.array_equal, fine, sphere))
    used = times_used(fine.faces)
    assert set(used) == {2}  # no cracks
    assert len(fine.points) - len(used) + len(fine.faces) == 2  # Euler's formula for a closed surface
    assert len(np.unique(fine.points.round(9), axis=0)) == len(fine.points)
    a, b, c = fine.points[fine.faces].transpose(1, 0, 2)
    assert (np.sum(np.cross(b - a, c - a) * (a + b + c), axis=1) > 0).all()  # wound as before
    assert longest_edges(fine).max() < 1.2 * longest_edges(sphere).max() / parts


def test_normals_turn_back_along_a_wave() -> None:
    """An edge that falls at both of its ends rises in between."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    tilted = np.tile([0.6, 0, 0.8], (3, 1))
    fine = subdivide(Surface(points, np.array([[0, 1, 2]]), tilted), 2)
    (middle,) = fine.normals[np.isclose(fine.points, [0.5, 0, 0]).all(axis=1)]
    np.testing.assert_allclose(middle, [0, 0, 1], atol=1e-12)


def test_flat_mesh_stays_flat() -> None:
    """Open, with an edge that both of its triangles run along in the same direction."""
    points = np.array([[0.0, 0, 3], [4, 0, 3], [0, 4, 3], [5, 5, 3]])
    faces = np.array([[0, 1, 2], [1, 2, 3]])
    up = np.tile([0.0, 0, 1], (4, 1))
    fine = subdivide(Surface(points, faces, up), 6)
    np.testing.assert_allclose(fine.points[:, 2], 3, rtol=1e-12)
    np.testing.assert_allclose(fine.normals, np.tile([0.0, 0, 1], (len(fine.points), 1)))
    assert sorted(set(times_used(fine.faces))) == [1, 2]
    corners = fine.points[fine.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    np.testing.assert_allclose(areas, np.repeat([8.0, 12.0], 36) / 36)


def test_edges_are_straight_where_normals_are_missing(sphere: Surface) -> None:
    partial = sphere._replace(normals=sphere.normals.copy())
    partial.normals[:3] = np.nan
    fine, flat = subdivide(partial, 2), subdivide(without_normals(sphere), 2)
    assert np.isfinite(fine.points).all()
    assert np.isnan(fine.normals[:3]).all()
    assert np.isnan(flat.normals).all()
    ends = np.unique(np.sort(sphere.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    middles = slice(len(sphere.points), len(sphere.points) + len(ends))
    np.testing.assert_allclose(flat.points[middles], sphere.points[ends].mean(axis=1))
    bent = np.linalg.norm(fine.points[middles] - flat.points[middles], axis=1) > 1e-3
    np.testing.assert_array_equal(bent, ~(ends < 3).all(axis=1))


def test_normals_of_the_fine_mesh_agree(sphere: Surface) -> None:
    fine = subdivide(sphere, 4)
    own = features.mesh_normals(fine.points, fine.faces)
    assert np.sum(own * fine.normals, axis=1).min() > np.cos(np.radians(8))
