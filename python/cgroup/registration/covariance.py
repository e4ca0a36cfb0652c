"""The covariance of a pose, also in the conventions of other libraries.

The coefficients were chosen on generated worlds, whose poses are exact (see
`docs/registration-internals.md`).
"""

from __future__ import annotations

from typing import Literal, TypeAlias

import numpy as np

from cgroup.registration.motions import OPEN, Resistance, resistance
from cgroup.registration.prepare import UNIT, PreparedScan, fine_surfaces
from cgroup.rigid import apply, invert
from cgroup.rigid.se3 import about, adjoint, motion, vector_of
from cgroup.types import FloatArray
from cgroup.verification import Alignment
from cgroup.verification.alignment import align_each
from cgroup.verification.schedule import DIFFERENT_UNITS

Convention: TypeAlias = Literal["gtsam", "g2o", "ros"]
CONVENTIONS: tuple[Convention, ...] = ("gtsam", "g2o", "ros")
# Largest number of independent residuals; number of neighbours with equal errors if there are few
INDEPENDENT, ALIKE = 1500.0, 2.5
LEAST_DEVIATION = 0.01  # least standard deviation of the residuals, in voxels
# Displacement of the pose in voxels, and samples of either surface that then pull it back
DISPLACED, SAMPLES = 1.0, 300
LEFT = 0.1  # weight of the remainder of each displacement
NOT_PULLED_BACK = 0.5  # remaining share of a displacement from which a motion is open
# Refinements and samples of either surface that pull back a pose displaced along a weak motion
ROUNDS, MORE_SAMPLES = 3, 1000

_LEAST_RESISTANCE = 1e-6


def count_open_motions(found: Alignment, source: PreparedScan, target: PreparedScan) -> int:
    """Return the number of motions that the surfaces do not constrain: 3 for a plane, 1 for a corridor.

    A motion is open if the surfaces hardly resist it, and if refining does not undo a displacement of a voxel
    along it. Normals of a rough plane seem to resist it but do not pull the pose back; a shallow relief does.
    """
    pose = found.T_target_source
    resisted = resistance(found.information, apply(pose, source.voxels.points))
    motions = resisted.motions[resisted.values <= OPEN]
    if len(motions) == 0:
        return 0
    left = _displace(resisted._replace(motions=motions), pose, source, target, MORE_SAMPLES, ROUNDS)
    return int((_share_left(left, resisted, source.voxel) >= NOT_PULLED_BACK).sum())


def covariance_of(found: Alignment, source: PreparedScan, target: PreparedScan) -> FloatArray:
    """Return the covariance of a refined pose, (6,6): of (rotation vector, translation), the target's frame.

    docs/registration-internals.md has the formula (after M. Brossard, S. Bonnabel and A. Barrau, *A new
    approach to 3D ICP covariance estimation*, RA-L 2020). Along an open motion the pose may lie anywhere
    within 8 voxels; farther poses are its rivals.
    """
    pose, voxel = found.T_target_source, source.voxel
    resisted = resistance(found.information, apply(pose, source.voxels.points))
    values, motions, middle, _, weight = resisted
    deviation = found.rmse if len(found.residuals) else voxel
    noise = (deviation**2 + (LEAST_DEVIATION * voxel) ** 2) * (1 / INDEPENDENT + ALIKE / max(weight, 1.0))
    left = _displace(resisted, pose, source, target, SAMPLES, 1)
    is_open = (values <= OPEN) & (_share_left(left, resisted, voxel) >= NOT_PULLED_BACK)
    is_open &= found.open_motion is not None
    variances = noise / np.maximum(values, _LEAST_RESISTANCE)
    variances += is_open * (DIFFERENT_UNITS * UNIT * voxel) ** 2 / 3
    change = np.linalg.inv(about(middle))
    return change @ ((motions.T * variances) @ motions + LEFT * left.T @ left) @ change.T


def _displace(
    resisted: Resistance,
    pose: FloatArray,
    source: PreparedScan,
    target: PreparedScan,
    samples: int,
    rounds: int,
) -> FloatArray:
    """Return the remainders of displacements by a voxel along k motions to both sides, (2k,6)."""
    steps = DISPLACED * source.voxel * np.concatenate([resisted.motions, -resisted.motions])
    poses = motion(steps, resisted.middle) @ pose
    for _ in range(rounds):
        refined = align_each(*fine_surfaces(source, target), poses, samples, source.threads)
        poses = np.array([one.T_target_source for one in refined])
    return np.array([vector_of(one, resisted.middle) for one in poses @ invert(pose)])


def _share_left(left: FloatArray, resisted: Resistance, voxel: float) -> FloatArray:
    """Return the remaining fraction of each displacement, averaged over both sides, (k,)."""
    lengths = np.linalg.norm(left / resisted.scale, axis=1)
    return lengths.reshape(2, -1).mean(axis=0) / (DISPLACED * voxel)


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
