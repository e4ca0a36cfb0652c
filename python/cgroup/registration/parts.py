"""Poses that align the centres of small separate parts of two clouds."""

from __future__ import annotations

from itertools import product

import numpy as np

from cgroup.group import group
from cgroup.registration.matching import group_poses
from cgroup.registration.prepare import PreparedScan
from cgroup.types import FloatArray, IndexArray
from cgroup.types.fields import Fields, own_correspondences

_LINKED = 2.0  # voxels along an edge of the cells whose neighbours belong to one part
_LEAST_PARTS, _MOST_PARTS = 5, 60
_SMALL, _LEAST_SHARE = 0.25, 0.5  # share of the voxels that a part has at most, and all such parts together
_ALIKE, _TOLERANCE = 2.0, 1.5  # ratio of the voxels of two parts; voxels between centres


def propose_by_parts(source: PreparedScan, target: PreparedScan, threads: int | None) -> FloatArray:
    """Return poses that align the centres of separate parts, (n,4,4).

    Parts of the same shape have the same descriptors, so each is matched with all of similar size, and
    SC2-PCR groups these matches. Empty unless both clouds consist of such parts.
    """
    parts = [find_parts(scan.voxels.points @ scan.scan.axes.T, scan.voxel) for scan in (source, target)]
    if min(len(sizes) for _, sizes in parts) < _LEAST_PARTS:
        return np.empty((0, 4, 4))
    ratios = np.abs(np.log(parts[0][1][:, None] / parts[1][1]))
    rows, partners = np.nonzero(ratios < np.log(_ALIKE))
    centers = [
        _center(scan.voxels.points, labels, len(sizes))
        for scan, (labels, sizes) in zip((source, target), parts, strict=True)
    ]
    matches = own_correspondences(Fields(centers[0][rows], centers[1][partners]))
    return group_poses(group(matches, "sc2_pcr", tolerance=_TOLERANCE * source.voxel, threads=threads))


def find_parts(points: FloatArray, voxel: float) -> tuple[IndexArray, IndexArray]:
    """Return the part of each point (n,), or -1, and the points of each part; of the largest small parts."""
    cells = np.floor((points - points.min(axis=0)) / (_LINKED * voxel)).astype(np.int64)
    cells, cell_of = np.unique(cells, axis=0, return_inverse=True)
    labels = _label_neighbors(cells)[cell_of.ravel()]
    names, labels, sizes = np.unique(labels, return_inverse=True, return_counts=True)
    small = np.flatnonzero(sizes <= _SMALL * len(points))
    if len(names) < _LEAST_PARTS or sizes[small].sum() < _LEAST_SHARE * len(points):
        return np.full(len(points), -1), np.empty(0, dtype=np.int64)
    chosen = small[np.argsort(-sizes[small], kind="stable")[:_MOST_PARTS]]
    renumbered = np.full(len(names), -1)
    renumbered[chosen] = np.arange(len(chosen))
    return renumbered[labels.ravel()], sizes[chosen]


def _label_neighbors(cells: IndexArray) -> IndexArray:
    """Return the least row of the connected component of each of the distinct cells (n,3)."""
    _, height, depth = cells.max(axis=0) + 3
    strides = np.array((height * depth, depth, 1))
    numbers = (cells + 1) @ strides  # ascending
    pairs = []
    for step in (step for step in product((-1, 0, 1), repeat=3) if step > (0, 0, 0)):
        sought = numbers + strides @ step
        rows = np.minimum(np.searchsorted(numbers, sought), len(numbers) - 1)
        found = np.flatnonzero(numbers[rows] == sought)
        pairs.append(np.column_stack([found, rows[found]]))
    one, other = np.concatenate(pairs).T
    labels = np.arange(len(cells))
    while True:
        before = labels.copy()
        least = np.minimum(labels[one], labels[other])
        np.minimum.at(labels, one, least)
        np.minimum.at(labels, other, least)
        labels = labels[labels]
        if np.array_equal(labels, before):
            return labels


def _center(points: FloatArray, labels: IndexArray, count: int) -> FloatArray:
    rows = np.flatnonzero(labels >= 0)
    sums = np.zeros((count, 3))
    np.add.at(sums, labels[rows], points[rows])
    return sums / np.bincount(labels[rows], minlength=count)[:, None]
