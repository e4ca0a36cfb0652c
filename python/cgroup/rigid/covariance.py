"""The covariance of a pose in the conventions of other libraries."""

from typing import Literal, TypeAlias

import numpy as np

from cgroup._checks.arrays import FloatArray
from cgroup.rigid import invert
from cgroup.rigid.se3 import about, adjoint

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
