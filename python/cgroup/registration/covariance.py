"""How precisely a pose is known: its covariance, and that of the conventions of other libraries.

The coefficients were chosen on generated worlds, whose poses are exact (see `docs/registration.md`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from cgroup.registration.judge import OPEN
from cgroup.registration.motions import about, adjoint, motion, vector_of
from cgroup.registration.prepare import UNIT, fine_surfaces
from cgroup.rigid import apply, invert
from cgroup.verification.alignment import align_each
from cgroup.verification.schedule import DIFFERENT_UNITS

if TYPE_CHECKING:
    from cgroup.registration.prepare import PreparedScan
    from cgroup.types import FloatArray
    from cgroup.verification import Alignment

Convention: TypeAlias = Literal["gtsam", "g2o", "ros"]
CONVENTIONS: tuple[Convention, ...] = ("gtsam", "g2o", "ros")

INDEPENDENT, ALIKE = 1500.0, 2.5
"""Residuals that err independently, however many there are; neighbours that err alike, where few are."""

LEAST_DEVIATION = 0.01
"""Standard deviation of the residuals at the least, in voxels."""

DISPLACED, SAMPLES = 1.0, 500
"""Voxels by which the pose is displaced, and samples of either surface that then pull it back."""

LEFT = 0.1
"""Weight of what is left of each displacement."""

NOT_PULLED_BACK = 0.5
"""Share of a displacement that is left where a motion is open."""

_LEAST_RESISTANCE = 1e-6


def covariance_of(found: Alignment, source: PreparedScan, target: PreparedScan) -> FloatArray:
    """Return the covariance of a refined pose, (6,6): of (rotation vector, translation), the target's frame.

    ``(s^2 + (0.01 v)^2) (W / 1500 + 2.5) H^-1 + 0.1 sum_k x_k x_k^T``: s the root mean square of the
    residuals, v the voxel, H and W the matrix and the weight of a point-to-plane step, x_k what is left of a
    displacement by a voxel, to either side along each eigenvector of H, after refining again (after M.
    Brossard, S. Bonnabel and A. Barrau, *A new approach to 3D ICP covariance estimation*, RA-L 2020). Along
    an open motion the pose may lie anywhere within 8 voxels: farther ones are weighed as its rivals.
    """
    pose, voxel = found.T_target_source, source.voxel
    points = apply(pose, source.voxels.points)
    center = np.median(points, axis=0)
    radius = float(np.median(np.linalg.norm(points - center, axis=1)))
    # Of motions about the centre, with rotations scaled such that they move the points by as much.
    scale = np.array([1 / radius] * 3 + [1.0] * 3)
    change = np.linalg.inv(about(center)) * scale
    weight = float(np.trace(found.information[3:, 3:]))  # normals are of unit length
    values, vectors = np.linalg.eigh(change.T @ found.information @ change)
    deviation = found.rmse if len(found.residuals) else voxel
    noise = (deviation**2 + (LEAST_DEVIATION * voxel) ** 2) * (weight / INDEPENDENT + ALIKE)
    covariance = (vectors * (noise / np.maximum(values, _LEAST_RESISTANCE * max(weight, 1.0)))) @ vectors.T
    displaced = DISPLACED * voxel * scale * np.concatenate([vectors.T, -vectors.T])
    starts = np.array([motion(vector, center) @ pose for vector in displaced])
    back = align_each(*fine_surfaces(source, target), starts, SAMPLES, source.threads)
    inverse = invert(pose)
    left = np.array([vector_of(one.T_target_source @ inverse, center) for one in back]) / scale
    covariance += LEFT * left.T @ left
    kept = np.linalg.norm(left, axis=1).reshape(2, 6).mean(axis=0) / (DISPLACED * voxel)
    is_open = (values <= OPEN * weight) & (kept >= NOT_PULLED_BACK)
    covariance += (vectors * is_open) @ vectors.T * (DIFFERENT_UNITS * UNIT * voxel) ** 2 / 3
    return change @ covariance @ change.T


def covariance_in(convention: Convention, covariance: FloatArray, pose: FloatArray) -> FloatArray:
    """Return a pose's covariance in the convention of another library."""
    # Of the source's origin along the target's axes, or in the source's frame.
    change = about(pose[:3, 3]) if convention == "ros" else adjoint(invert(pose))
    if convention == "g2o":
        change[:3] /= 2  # the vector part of a quaternion
    if convention != "gtsam":
        change = np.roll(change, 3, axis=0)
    return change @ covariance @ change.T
