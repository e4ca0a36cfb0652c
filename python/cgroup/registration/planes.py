"""Planes of a scan, and the number of planes that a pose aligns with another scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import default_rng  # NumPy loads it late, and there may be no memory for it by then

from cgroup.features import within
from cgroup.rigid import apply
from cgroup.rigid.transforms import cross_products
from cgroup.types import FloatArray, IndexArray

MOST_PLANES = 12  # largest number of planes of a scan
_HYPOTHESES, _TRIED, _SAMPLES = 100, 40, 1000  # triples of points; places tried for each; points that vote
_REACH, _THICK, _LEAST, _LEAST_SHARE = 20.0, 0.3, 40, 0.008  # voxels; voxels; points; share of the points
_ALIKE, _SAME, _OFFSET, _BESIDE, _SHARED = np.cos(np.radians(4)), np.cos(np.radians(8)), 0.8, 5.0, 0.1
_APART = 1.2  # voxels between two parallel planes
_EDGE = 1.0  # voxels above a plane, and half of those beside it, that are part of it: where planes meet
_CELL = 4.0  # voxels within which samples go wrong together
_SIDE = 200  # points of a plane that are compared with another's


@dataclass(frozen=True, eq=False)
class Planes:
    """Planes of a scan: normals and centres (k,3), some points of each, and each voxel's plane or -1."""

    normals: FloatArray
    centers: FloatArray
    members: list[FloatArray]
    labels: IndexArray


def find_planes(points: FloatArray, voxel: float) -> Planes:
    """Find planes one after another from random triples of nearby points."""
    rng = default_rng(0)
    labels = np.full(len(points), -1)
    left = np.arange(len(points))
    normals, centers, members = [], [], []
    least = max(_LEAST, _LEAST_SHARE * len(points))
    while len(normals) < MOST_PLANES and len(left) >= least:
        candidates = points[left]
        rows = _fit_plane(candidates, voxel, rng)
        if len(rows) < least:
            break
        normal, center = _fit(candidates[rows])
        away = np.abs((candidates - center) @ normal)
        rows = left[away < _THICK * voxel]
        if len(rows) < least:
            break
        normal, center = _fit(points[rows])
        labels[rows] = len(normals)
        normals.append(normal)
        centers.append(center)
        members.append(points[rows[:: len(rows) // _SIDE + 1]])
        left = left[np.abs((candidates - center) @ normal) >= 2 * _THICK * voxel]
    return Planes(np.reshape(normals, (-1, 3)), np.reshape(centers, (-1, 3)), members, labels)


def _fit_plane(points: FloatArray, voxel: float, rng: np.random.Generator) -> IndexArray:
    """Return the rows of the points on the best hypothesis; few rows mean no plane."""
    voters = points[rng.permutation(len(points))[:_SAMPLES]]
    axes = np.ascontiguousarray(voters.T)  # coordinate by coordinate, which is faster
    starts = voters[rng.integers(len(voters), size=_HYPOTHESES)]
    sides = np.take(axes, rng.integers(len(voters), size=(_HYPOTHESES, _TRIED)), axis=1)
    sides -= starts.T[:, :, None]
    near = np.sum(sides**2, axis=0) < (_REACH * voxel) ** 2
    enough, rows, chosen = near.sum(axis=1) >= 2, np.arange(_HYPOTHESES), []
    for _ in range(2):
        first = near.argmax(axis=1)
        chosen.append(sides[:, rows, first].T)
        near[rows, first] = False
    normals = cross_products(*chosen)
    sizes = np.linalg.norm(normals, axis=1)
    wide = (sizes > (3 * voxel) ** 2) & enough
    if not wide.any():
        return np.empty(0, dtype=np.int64)
    normals, starts = normals[wide] / sizes[wide, None], starts[wide]
    offsets = (normals * starts).sum(axis=1)
    heights = normals @ axes
    heights -= offsets[:, None]
    np.abs(heights, out=heights)
    best = int(np.argmax(np.count_nonzero(heights < _THICK * voxel, axis=1)))
    return np.flatnonzero(np.abs(points @ normals[best] - offsets[best]) < _THICK * voxel)


def _fit(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    center = points.mean(axis=0)
    offsets = points - center
    return np.linalg.eigh(offsets.T @ offsets)[1][:, 0], center


def number_cells(
    points: FloatArray, planes: Planes, voxels: FloatArray, voxel: float, axes: FloatArray
) -> IndexArray:
    """Return the cell of each point along axes; -1 for points near a plane of the voxels."""
    by_a_plane = np.zeros(len(points), dtype=bool)
    for label, (normal, center) in enumerate(zip(planes.normals, planes.centers, strict=True)):
        rows = np.flatnonzero(np.abs((points - center) @ normal) < _EDGE * voxel)
        by_a_plane[rows] |= within(points[rows], voxels[planes.labels == label], 2 * _EDGE * voxel)
    along = points @ axes.T
    corners = np.floor((along - along.min(axis=0)) / (_CELL * voxel)).astype(np.int64)
    numbers = np.ravel_multi_index(tuple(corners.T), tuple(corners.max(axis=0) + 1))
    return np.where(by_a_plane, -1, np.unique(numbers, return_inverse=True)[1])


def count_agreeing(source: Planes, target: Planes, pose: FloatArray, voxel: float) -> int:
    """Count the planes that a pose aligns with planes, each normal and offset once."""
    counted: list[tuple[FloatArray, float]] = []
    middle = target.centers.mean(axis=0) if len(target.centers) else np.zeros(3)
    for normal, members in zip(source.normals @ pose[:3, :3].T, source.members, strict=True):
        alike = np.flatnonzero(np.abs(target.normals @ normal) > _ALIKE)
        if len(alike) == 0:
            continue
        moved = apply(pose, members)
        normals = target.normals[alike]
        heights = moved @ normals.T - (normals * target.centers[alike]).sum(axis=1)
        near = np.abs(heights) <= _OFFSET * voxel
        for row in alike[2 * near.sum(axis=0) > len(moved)]:  # most of its points lie on the other
            other, center = target.normals[row], target.centers[row]
            apart = _squared_distances(moved - center, target.members[row] - center).min(axis=1)
            if np.count_nonzero(apart < (_BESIDE * voxel) ** 2) < _SHARED * len(moved):
                continue
            height = float(((moved - middle) @ other).mean())
            if not any(_is_same(other, height, *known, voxel) for known in counted):
                counted.append((other, height))
            break
    return len(counted)


def _squared_distances(one: FloatArray, other: FloatArray) -> FloatArray:
    return (one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2 * (one @ other.T)


def _is_same(normal: FloatArray, height: float, other: FloatArray, level: float, voxel: float) -> bool:
    cosine = float(normal @ other)
    return abs(cosine) > _SAME and abs(height * np.sign(cosine) - level) < _APART * voxel
