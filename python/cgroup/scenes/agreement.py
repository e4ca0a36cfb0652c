"""Consistency of poses between scans: around triangles, and with the poses of a scene."""

import itertools

import numpy as np

from cgroup.rigid.se3 import adjoint, cross, rotation_vectors
from cgroup.scenes import settings
from cgroup.types import FloatArray, IndexArray


def move_each(poses: FloatArray, points: FloatArray) -> FloatArray:
    """Return each point (n,3) under its own pose."""
    return np.einsum("nij,nj->ni", poses[:, :3, :3], points) + poses[:, :3, 3]


def move_frames(poses: FloatArray, points: FloatArray) -> FloatArray:
    """Return the poses (n,4,4) of frames whose origins are moved to points (n,3)."""
    moved = poses.copy()
    moved[:, :3, 3] = move_each(poses, points)
    return moved


def center_links(pairs: IndexArray, poses: FloatArray, middles: FloatArray) -> FloatArray:
    """Return poses of sources on targets, (n,4,4), between frames at the middles of the scans."""
    sources, targets = pairs.T
    moved = move_frames(poses, middles[sources])
    moved[:, :3, 3] -= middles[targets]
    return moved


def squared_errors(
    found: FloatArray, expected: FloatArray, covariance: FloatArray, middles: FloatArray, voxel: float
) -> FloatArray:
    """Return the squared Mahalanobis distances between found and expected poses of sources, (n,).

    The covariances (n,6,6) are those of both together, in the target's frame; `middles` (n,3) are of the
    sources, and the voxel is the unit of the further deviation of every pose.
    """
    places, landed = move_each(expected, middles), move_each(found, middles)
    turns = rotation_vectors(found[:, :3, :3] @ expected[:, :3, :3].transpose(0, 2, 1))
    errors = np.concatenate([turns, landed - places], axis=1)
    change = np.tile(np.eye(6), (len(found), 1, 1))
    change[:, 3:, :3] = -cross(places)
    spread = change @ covariance @ change.transpose(0, 2, 1)
    spread += np.diag([settings.LEAST_TURN**2] * 3 + [(settings.LEAST_SHIFT * voxel) ** 2] * 3)
    return np.einsum("ni,ni->n", errors, np.linalg.solve(spread, errors[:, :, None])[:, :, 0])


def find_triangles(pairs: IndexArray, count: int) -> IndexArray:
    """Return the rows of the pairs (i,j), (i,k), (j,k), i < j < k, of each triangle of nodes, (t,3)."""
    rows: dict[tuple[int, int], list[int]] = {}
    beyond: list[set[int]] = [set() for _ in range(count)]
    for row, (one, other) in enumerate(np.sort(pairs, axis=1).tolist()):
        rows.setdefault((one, other), []).append(row)
        beyond[one].add(other)
    found = [
        triple
        for (i, j), some in rows.items()
        for k in sorted(beyond[i] & beyond[j])
        for triple in itertools.product(some, rows[i, k], rows[j, k])
    ]
    return np.array(found, dtype=np.int64).reshape(-1, 3)


def weigh_by_triangles(
    pairs: IndexArray,
    poses: FloatArray,
    covariance: FloatArray,
    prior: FloatArray,
    overlap: FloatArray,
    middles: FloatArray,
    voxel: float,
) -> FloatArray:
    """Return the probability that each pose is correct, given the consistent triangles of poses.

    A triangle of correct poses closes. Another closes by chance, in one of 50 cases. If two of its scans
    overlap, their poses on the third can be wrong for the same reason: the chance is then their overlap. The
    probabilities of the other two poses are those of the previous round (loopy belief propagation).

    The arrays have a row per pose: source and target, the pose in the target's frame with its covariance, its
    probability from the two scans alone, and the overlap of the surfaces. `middles` are those of all scans.
    """
    triangles = find_triangles(pairs, len(middles))
    if len(triangles) == 0:
        return prior.copy()
    bounded = np.clip(prior, settings.LEAST_SURE, settings.SUREST)
    logits = np.log(bounded) - np.log1p(-bounded)
    i, j = np.sort(pairs[triangles[:, 0]], axis=1).T  # i < j
    k = pairs[triangles[:, 1]].sum(axis=1) - i
    sides = zip(triangles.T, (i, i, k), strict=True)
    ways = (_into(to, pairs, poses, covariance, rows) for rows, to in sides)
    (direct, one), (first, two), (second, three) = ways
    turned = adjoint(first)
    total = one + two + turned @ three @ turned.transpose(0, 2, 1)
    closes = squared_errors(first @ second, direct, total, middles[j], voxel) < settings.DISAGREES
    beliefs = logits.copy()
    for _ in range(settings.BELIEF_ROUNDS):
        chances = np.clip(1.0 / (1.0 + np.exp(-beliefs)), 1e-6, settings.SUREST)
        updated = logits.copy()
        for own, others in ((0, (1, 2)), (1, (0, 2)), (2, (0, 1))):
            both = chances[triangles[:, others[0]]] * chances[triangles[:, others[1]]]
            alike = np.clip(overlap[triangles[:, others]].max(axis=1), settings.CLOSED_BY_CHANCE, 1.0)
            told = np.where(closes, np.log(both / alike + 1 - both), np.log1p(-both))
            np.add.at(updated, triangles[:, own], told)
        beliefs = np.clip(0.5 * (beliefs + updated), -30, 30)
    return 1.0 / (1.0 + np.exp(-beliefs))


def _into(
    to: IndexArray, pairs: IndexArray, poses: FloatArray, covariance: FloatArray, rows: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Return poses into the frames of some nodes, inverted if needed, and their covariances."""
    as_found = pairs[rows, 1] == to
    forward, spread = poses[rows], covariance[rows]
    back = np.asarray(np.linalg.inv(forward), np.float64)
    change = adjoint(back)
    turned = change @ spread @ change.transpose(0, 2, 1)
    return np.where(as_found[:, None, None], forward, back), np.where(as_found[:, None, None], spread, turned)
