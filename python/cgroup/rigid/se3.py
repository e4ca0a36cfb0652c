"""Small motions (a rotation vector, and the translation of a point), and covariances of poses."""

from typing import Literal, TypeAlias

import numpy as np

from cgroup._checks.arrays import FloatArray
from cgroup.rigid.transforms import apply, axis_of, invert

_FADED = 1e-9  # sine of a rotation below which it is rounding
_ROUNDED = 1e-9  # share of the largest variance below which one is rounding


def cross(vectors: FloatArray) -> FloatArray:
    """Return the matrices (...,3,3) of the cross products with vectors (...,3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    none = np.zeros_like(x)
    return np.stack([none, -z, y, z, none, -x, -y, x, none], axis=-1).reshape(*vectors.shape, 3)


def motion(vectors: FloatArray, point: FloatArray) -> FloatArray:
    """Return transforms (...,4,4) of motions (...,6), a rotation vector and the translation of the point."""
    angles = np.linalg.norm(vectors[..., :3], axis=-1)[..., None, None]
    turns = cross(vectors[..., :3])
    transforms = np.tile(np.eye(4), (*vectors.shape[:-1], 1, 1))
    # sin(a) / a and (1 - cos(a)) / a^2, with limits at 0
    first, second = np.sinc(angles / np.pi), np.sinc(angles / (2 * np.pi)) ** 2 / 2
    transforms[..., :3, :3] += first * turns + second * (turns @ turns)
    transforms[..., :3, 3] = point + vectors[..., 3:] - transforms[..., :3, :3] @ point
    return transforms


def vector_of(transform: FloatArray, point: FloatArray) -> FloatArray:
    """Return the motion (rotation vector, translation of the point) of a transform, below half a turn."""
    turn = transform[:3, :3]
    sines = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / 2
    sine = np.linalg.norm(sines)
    angle = np.arctan2(sine, (np.trace(turn) - 1) / 2)
    return np.concatenate([sines * (angle / sine if sine else 1.0), apply(transform, point[None])[0] - point])


def rotation_vectors(rotations: FloatArray) -> FloatArray:
    """Return the vector of each rotation, (n,3)."""
    sines = (rotations - rotations.transpose(0, 2, 1))[:, [2, 0, 1], [1, 2, 0]] / 2
    sine, cosine = np.linalg.norm(sines, axis=1), (np.trace(rotations, axis1=1, axis2=2) - 1) / 2
    vectors = sines * (np.arctan2(sine, cosine) / np.maximum(sine, 1e-300))[:, None]
    vectors[sine < _FADED] = sines[sine < _FADED]
    for row in np.flatnonzero((sine < _FADED) & (cosine < 0)):  # half a turn, which sines do not show
        vectors[row] = np.pi * axis_of(rotations[row])
    return vectors


def about(point: FloatArray) -> FloatArray:
    """Return the change of small motions from the translation of the origin to that of a point."""
    change = np.eye(6)
    change[3:, :3] = -cross(point)
    return change


def adjoint(pose: FloatArray) -> FloatArray:
    """Return the change of motions (...,6,6) by poses (...,4,4): ``pose Exp(x) = Exp(Ad x) pose``."""
    change = np.zeros((*pose.shape[:-2], 6, 6))
    change[..., :3, :3] = change[..., 3:, 3:] = pose[..., :3, :3]
    change[..., 3:, :3] = cross(pose[..., :3, 3]) @ pose[..., :3, :3]
    return change


def information_of(covariance: FloatArray) -> FloatArray:
    """Return the inverses (n,6,6) of covariances of motions, whose points may be far from the origin."""
    turned, mixed = covariance[:, :3, :3], covariance[:, :3, 3:]
    lever = np.linalg.solve(turned, mixed)
    values, axes = np.linalg.eigh(covariance[:, 3:, 3:] - mixed.transpose(0, 2, 1) @ lever)
    known = np.maximum(values, _ROUNDED * values[:, 2:])  # rounding may make them negative
    inner = axes / known[:, None] @ axes.transpose(0, 2, 1)
    change, blocks = np.tile(np.eye(6), (2, len(covariance), 1, 1))
    change[:, :3, 3:] = -lever
    blocks[:, :3, :3], blocks[:, 3:, 3:] = np.linalg.inv(turned), inner
    information = change @ blocks @ change.transpose(0, 2, 1)
    return (information + information.transpose(0, 2, 1)) / 2


Convention: TypeAlias = Literal["gtsam", "g2o", "ros"]
CONVENTIONS: tuple[Convention, ...] = ("gtsam", "g2o", "ros")


def deviations_at(covariance: FloatArray, place: FloatArray) -> tuple[float, float]:
    """Return standard deviations of a pose: of its rotation in degrees, and of a point of the target."""
    change = about(place)
    turned, moved = np.diagonal(change @ covariance @ change.T).reshape(2, 3).sum(axis=1) ** 0.5
    return float(np.degrees(turned)), float(moved)


def covariance_in(convention: Convention, covariance: FloatArray, pose: FloatArray) -> FloatArray:
    """Return a pose's covariance in the convention of another library."""
    # Of the source's origin along the target's axes, or in the source's frame.
    change = about(pose[:3, 3]) if convention == "ros" else adjoint(invert(pose))
    if convention == "g2o":
        change[:3] /= 2  # the vector part of a quaternion
    if convention != "gtsam":
        change = np.roll(change, 3, axis=0)
    return change @ covariance @ change.T
