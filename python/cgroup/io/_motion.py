"""Motions of records: positions, directions, and the rotations and colours of Gaussian splats."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cgroup._checks.values import as_length
from cgroup.errors import InputError
from cgroup.rigid import apply, check_rigid
from cgroup.rigid.transforms import quaternions, scaling
from cgroup.types import FloatArray

XYZ = ("x", "y", "z")
_POINTS = (XYZ, ("vp_x", "vp_y", "vp_z"), ("view_px", "view_py", "view_pz"))
_DIRECTIONS = (
    ("nx", "ny", "nz"),
    ("normal_x", "normal_y", "normal_z"),
    ("normalx", "normaly", "normalz"),
    ("principal_curvature_x", "principal_curvature_y", "principal_curvature_z"),
    *((f"{axis}_axisx", f"{axis}_axisy", f"{axis}_axisz") for axis in XYZ),  # of a camera
)
_STEPS = (("x_t", "y_t", "z_t"),)  # along the pulse of a waveform, per time
_ROTATION = tuple(f"rot_{k}" for k in range(4))  # w x y z
_SCALES = tuple(f"scale_{k}" for k in range(3))
_REST = "f_rest_"
_DEGREES = {
    9: 1,
    24: 2,
    45: 3,
}  # of spherical harmonics, by the number of their coefficients in three colours
MOST_LOST = 1e-6  # share of a cloud's size by which the rounding of a format may move points
_HALF_UNIT = 2.0**-24  # rounding error of single precision


@dataclass(frozen=True)
class Motion:
    """A similarity, and notes about what a file cannot keep under it."""

    matrix: FloatArray
    scale: float
    notes: list[str] = field(default_factory=list)

    @staticmethod
    def of(pose: ArrayLike, scale: float) -> Motion:
        """Return the motion that scales by a factor, and then moves by a pose."""
        scale = as_length("scale", scale)
        return Motion(check_rigid(pose, "pose") @ scaling(scale), scale)

    @property
    def turning(self) -> FloatArray:
        """The rotation (3,3)."""
        return self.matrix[:3, :3] / self.scale

    def note(self, text: str) -> None:
        """Add a note, once."""
        if text not in self.notes:
            self.notes.append(text)

    def box(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return the lowest and highest corner (2,3) of a moved box."""
        corners = np.stack(np.meshgrid(*np.stack([low, high], axis=1)), axis=-1).reshape(-1, 3)
        moved = apply(self.matrix, corners)
        return np.stack([moved.min(axis=0), moved.max(axis=0)])

    def needs_double(self, blocks: Iterable[FloatArray]) -> bool:
        """Return whether single precision has too few digits for moved points."""
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for points in blocks:
            finite = points[np.isfinite(points).all(axis=1)].astype(np.float64)
            low, high = (
                np.minimum(low, finite.min(axis=0, initial=np.inf)),
                np.maximum(high, finite.max(axis=0, initial=-np.inf)),
            )
        if not (low <= high).all():  # no point is finite
            return False
        reach = float(np.abs(self.box(low, high)).max())
        return reach * _HALF_UNIT > MOST_LOST * self.scale * float(np.linalg.norm(high - low))


class Mover:
    """Moves records in place, by the names of their fields in lower case."""

    def __init__(self, motion: Motion, names: Iterable[str]) -> None:
        there = set(names)
        self._motion = motion
        steps = motion.matrix[:3, :3]
        self._groups = [(group, None) for group in _POINTS if there >= {*group}]
        self._groups += [(group, motion.turning) for group in _DIRECTIONS if there >= {*group}]
        self._groups += [(group, steps) for group in _STEPS if there >= {*group}]
        self.names = {name for group, _ in self._groups for name in group}
        is_splat = there >= {*_ROTATION, _SCALES[0]}
        self._scales = [name for name in _SCALES if is_splat and name in there]
        self._rotation = _ROTATION if is_splat else ()
        rest = [name for name in there if name.startswith(_REST)] if is_splat else []
        self._degree = _DEGREES.get(len(rest), 0)
        if rest and not self._degree:
            motion.note(f"{_REST}*: not rotated; {len(rest)} coefficients are of no degree from 1 to 3")
        self._rest = [f"{_REST}{k}" for k in range(len(rest))] if self._degree else []
        self.names.update(self._scales, self._rotation, self._rest)

    def move(self, records: Any) -> None:  # noqa: ANN401 - records of NumPy or laspy
        """Move positions, rotate directions and splats."""
        for group, turning in self._groups:
            rows = _get(records, group)
            _set(records, group, apply(self._motion.matrix, rows) if turning is None else rows @ turning.T)
        if self._motion.scale != 1.0 and self._scales:
            _set(records, self._scales, _get(records, self._scales) + math.log(self._motion.scale))
        if self._rotation:
            _set(records, self._rotation, _turn(self._motion.turning, _get(records, self._rotation)))
        if self._rest:
            rows = _get(records, self._rest).reshape(len(records), 3, -1)
            for degree in range(1, self._degree + 1):
                part = slice(degree**2 - 1, (degree + 1) ** 2 - 1)
                rows[:, :, part] = rows[:, :, part] @ rotate_harmonics(self._motion.turning, degree).T
            _set(records, self._rest, rows.reshape(len(records), -1))


def _get(records: Any, names: Sequence[str]) -> FloatArray:  # noqa: ANN401
    return np.stack([np.asarray(records[name], np.float64) for name in names], axis=1)


def _set(records: Any, names: Sequence[str], rows: FloatArray) -> None:  # noqa: ANN401
    for name, values in zip(names, rows.T, strict=True):
        kind = records[name].dtype
        if kind.kind in "iu":
            limits = np.iinfo(kind)
            values = np.clip(np.rint(values), limits.min, limits.max)  # noqa: PLW2901
        records[name] = values


def _turn(rotation: FloatArray, rows: FloatArray) -> FloatArray:
    """Return quaternions w x y z after a rotation, of the same lengths."""
    x, y, z, w = quaternions(rotation[None])[0]
    product = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
    return rows @ product.T


def rotate_harmonics(rotation: FloatArray, degree: int) -> FloatArray:
    """Return the matrix that rotates coefficients of a degree: Wigner's, in the basis of Gaussian splats.

    It is solved from directions d: basis at R d times new coefficients is basis at d times old ones.
    """
    golden = np.arange(4 * degree + 4)
    heights, angles = 1 - (2 * golden + 1) / len(golden), golden * (math.pi * (3 - math.sqrt(5)))
    across = np.sqrt(1 - heights**2)
    directions = np.stack([across * np.cos(angles), across * np.sin(angles), heights], axis=1)
    after, before = _basis(directions @ rotation.T, degree), _basis(directions, degree)
    return np.asarray(np.linalg.lstsq(after, before, rcond=None)[0], np.float64)


def _basis(directions: FloatArray, degree: int) -> FloatArray:
    """Return the real harmonics (n,2l+1) of a degree, with the signs of 3D Gaussian splatting."""
    x, y, z = directions.T
    if degree == 1:
        return 0.4886025119029199 * np.stack([-y, z, -x], axis=1)
    if degree == 2:
        a, b = 1.0925484305920792, 0.31539156525252005
        rows = [a * x * y, -a * y * z, b * (2 * z * z - x * x - y * y), -a * x * z, a / 2 * (x * x - y * y)]
        return np.stack(rows, axis=1)
    if degree != 3:
        raise InputError("degree", degree, "give 1, 2 or 3")
    a, b, c, d = 0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154
    e = 4 * z * z - x * x - y * y
    rows = [
        *(
            -a * y * (3 * x * x - y * y),
            b * x * y * z,
            -c * y * e,
            d * z * (2 * z * z - 3 * x * x - 3 * y * y),
        ),
        *(-c * x * e, b / 2 * z * (x * x - y * y), -a * x * (x * x - 3 * y * y)),
    ]
    return np.stack(rows, axis=1)
