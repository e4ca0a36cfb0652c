"""Subdivide a triangle mesh by curved patches that follow its vertex normals.

Vlachos, Peters, Boyd and Mitchell: Curved PN triangles, I3D 2001. Each triangle becomes a cubic Bezier patch
through its corners, at right angles to their normals. An edge of a patch depends on the two ends of the edge
only, so neighbours meet without a crack.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cgroup.types import FloatArray, IndexArray


class Surface(NamedTuple):
    """Vertices (N,3), triangles (F,3) as rows of them, and unit normals (N,3); NaN where none is known."""

    points: FloatArray
    faces: IndexArray
    normals: FloatArray


def subdivide(surface: Surface, parts: int) -> Surface:
    """Cut every triangle into equal parts, curved by the normals of its corners.

    Any triangles will do: open, of several pieces, with edges of more than two triangles. An edge is cut into
    so many parts, at least 1, and a triangle into the square of it; at an end without a normal an edge is
    straight. The vertices come as they were, then those on edges, then those within triangles. Normals are
    quadratic interpolants of those at the corners; faces are wound as their triangle was.
    """
    bends = np.nan_to_num(surface.normals)
    ends, edge_of = _edges(surface.faces)
    steps = np.arange(1, parts) / parts
    on_edges = _on_edges(surface.points, bends, ends, steps)
    grid = _grid(parts)
    inner = grid[(grid > 0).all(axis=1)]
    within = _within(surface.points, bends, surface.faces, inner / parts)
    rows = _rows(surface, edge_of, len(ends), grid)
    return Surface(
        np.concatenate([surface.points, on_edges[0], within[0]]),
        rows[:, _small_triangles(grid)].reshape(-1, 3),
        np.concatenate([surface.normals, _unit(on_edges[1]), _unit(within[1])]),
    )


def longest_edges(surface: Surface) -> FloatArray:
    """Longest edge of each triangle."""
    corners = surface.points[surface.faces]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)


def _edges(faces: IndexArray) -> tuple[IndexArray, IndexArray]:
    """Find the ends (E,2) of each edge, and the edges (F,3) opposite to the corners of each face."""
    sides = np.stack([faces[:, [1, 2]], faces[:, [2, 0]], faces[:, [0, 1]]], axis=1)
    ends, edge_of = np.unique(np.sort(sides, axis=2).reshape(-1, 2), axis=0, return_inverse=True)
    return ends, edge_of.reshape(-1, 3)


def _control_point(near: FloatArray, far: FloatArray, normal: FloatArray) -> FloatArray:
    """One third of the way from a corner to another, moved onto the plane that touches at the first."""
    rise = np.sum((far - near) * normal, axis=-1, keepdims=True)
    return (2 * near + far - rise * normal) / 3


def _middle_normal(a: FloatArray, b: FloatArray, normal_a: FloatArray, normal_b: FloatArray) -> FloatArray:
    """Sum of the normals at two corners, mirrored at the plane across the edge between them."""
    edge, total = b - a, normal_a + normal_b
    length2 = np.sum(edge * edge, axis=-1, keepdims=True)
    share = 2 * np.sum(edge * total, axis=-1, keepdims=True) / np.where(length2 == 0, 1, length2)
    return _unit(total - share * edge, 1.0)


def _on_edges(
    points: FloatArray, normals: FloatArray, ends: IndexArray, steps: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points and normals along each edge, from its first end to its second."""
    (a, b), (normal_a, normal_b) = (values[ends].transpose(1, 0, 2) for values in (points, normals))
    t, s = steps[None, :, None], 1 - steps[None, :, None]
    controls = a, _control_point(a, b, normal_a), _control_point(b, a, normal_b), b
    weights = s**3, 3 * s * s * t, 3 * s * t * t, t**3
    places = sum(weight * control[:, None] for weight, control in zip(weights, controls, strict=True))
    middle = _middle_normal(a, b, normal_a, normal_b)
    directions = s * s * normal_a[:, None] + 2 * s * t * middle[:, None] + t * t * normal_b[:, None]
    return np.reshape(places, (-1, 3)), directions.reshape(-1, 3)


def _within(
    points: FloatArray, normals: FloatArray, faces: IndexArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Points and normals at barycentric weights (G,3) within each triangle."""
    corners, bends = points[faces], normals[faces]
    controls, cubic, directions, quadratic = [], [], [], []
    for i in range(3):
        controls.append(corners[:, i])
        cubic.append(weights[:, i] ** 3)
        directions.append(bends[:, i])
        quadratic.append(weights[:, i] ** 2)
        j = (i + 1) % 3
        for near, far in ((i, j), (j, i)):
            controls.append(_control_point(corners[:, near], corners[:, far], bends[:, near]))
            cubic.append(3 * weights[:, near] ** 2 * weights[:, far])
        directions.append(_middle_normal(corners[:, i], corners[:, j], bends[:, i], bends[:, j]))
        quadratic.append(2 * weights[:, i] * weights[:, j])
    # The centre lies half as far again from the flat triangle as the mean of the edges' control points.
    edges = np.mean([controls[k] for k in (1, 2, 4, 5, 7, 8)], axis=0)
    controls.append(edges + (edges - corners.mean(axis=1)) / 2)
    cubic.append(6 * weights.prod(axis=1))
    return (
        np.einsum("kg,kfx->fgx", cubic, controls).reshape(-1, 3),
        np.einsum("kg,kfx->fgx", quadratic, directions).reshape(-1, 3),
    )


def _rows(surface: Surface, edge_of: IndexArray, edges: int, grid: IndexArray) -> IndexArray:
    """Row (F,G) of the vertex at each place of the grid of each triangle."""
    parts = int(grid[0].sum())
    faces, count = surface.faces, len(surface.points)
    rows = np.empty((len(faces), len(grid)), dtype=np.int64)
    inner = (grid > 0).all(axis=1)
    first_inner = count + edges * (parts - 1)
    rows[:, inner] = first_inner + np.arange(len(faces) * int(inner.sum())).reshape(len(faces), -1)
    for corner in range(3):
        rows[:, grid[:, corner] == parts] = faces[:, [corner]]
        start, end = (corner + 1) % 3, (corner + 2) % 3
        side = (grid[:, corner] == 0) & (grid.max(axis=1) < parts)
        forwards = faces[:, [start]] < faces[:, [end]]
        step = np.where(forwards, grid[side, end], grid[side, start])
        rows[:, side] = count + edge_of[:, [corner]] * (parts - 1) + step - 1
    return rows


def _grid(parts: int) -> IndexArray:
    """Places (G,3) on a triangle whose edges are cut into parts, as whole barycentric weights."""
    i, j = (steps.reshape(-1) for steps in np.indices((parts + 1, parts + 1)))
    places = np.stack([parts - i - j, i, j], axis=1)
    return places[places[:, 0] >= 0]


def _small_triangles(grid: IndexArray) -> IndexArray:
    """Triangles between neighbouring places, wound as the large one."""
    parts = int(grid[0].sum())
    number = np.full((parts + 2, parts + 2), -1)
    number[grid[:, 1], grid[:, 2]] = np.arange(len(grid))
    here, right, up, across = number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]
    small = np.concatenate(
        [np.stack(three, axis=-1).reshape(-1, 3) for three in ((here, right, up), (right, across, up))]
    )
    return small[(small >= 0).all(axis=1)]


def _unit(vectors: FloatArray, length_of_none: float = np.nan) -> FloatArray:
    """Vectors of length 1; NaN where there is no direction, or 0 if its length is taken for 1."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length == 0, length_of_none, length)
