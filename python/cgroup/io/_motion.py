"""Motions of columns: positions, directions, and the rotations and colours of Gaussian splats."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.polynomial.legendre import Legendre
from numpy.typing import NDArray

from cgroup import _core
from cgroup.rigid import apply
from cgroup.rigid.transforms import quaternions
from cgroup.types import FloatArray


def _axes(*forms: str) -> list[tuple[str, ...]]:
    return [tuple(form.format(axis) for axis in "xyz") for form in forms]


XYZ, NORMAL = _axes("{}", "n{}")
CORNERS = [XYZ, *_axes("corner_1_{}", "corner_2_{}")]  # of the triangles of STL
_POINTS = [*CORNERS, *_axes("vp_{}", "view_p{}")]
_CAMERA = _axes("x_axis{}", "y_axis{}", "z_axis{}")
_DIRECTIONS = [NORMAL, *_axes("normal_{}", "normal{}", "principal_curvature_{}"), *_CAMERA]
_ROTATION = tuple(f"rot_{k}" for k in range(4))  # w x y z
_SCALES = tuple(f"scale_{k}" for k in range(3))
MOST_LOST = _core.MOST_LOST  # share of the size of a cloud by which a format may move points
_HALF_UNIT = 2.0**-24  # rounding error of single precision


@dataclass(frozen=True)
class Motion:
    """A similarity, and notes about what a file cannot keep under it."""

    matrix: FloatArray
    scale: float
    stem: str = ""  # of the written file
    notes: list[str] = field(default_factory=list)
    ends: list[FloatArray] = field(default_factory=list)  # corners of boxes of moved points

    @property
    def turning(self) -> FloatArray:
        """The rotation (3,3)."""
        return self.matrix[:3, :3] / self.scale

    def needs_double(self) -> bool:
        """Return whether single precision has too few digits for the moved points."""
        if not self.ends:
            return False
        low, high = np.min(self.ends, axis=0), np.max(self.ends, axis=0)
        lost = float(np.abs([low, high]).max()) * _HALF_UNIT
        return lost > MOST_LOST * float(np.linalg.norm(high - low))

    def names(self, names: Iterable[str]) -> list[str]:
        """Return the columns, named in lower case, that `move` changes."""
        return [*self.move({name: np.empty(0) for name in names})]

    def move(self, columns: Mapping[str, NDArray[np.generic]]) -> dict[str, FloatArray]:
        """Return the columns that change: positions, directions and splats."""
        moved: dict[str, FloatArray] = {}
        linear, there = self.matrix[:3, :3], columns.keys()
        for groups, turning in ((_POINTS, None), (_DIRECTIONS, self.turning), (_axes("{}_t"), linear)):
            for names in (group for group in groups if there >= {*group}):
                rows = _table(columns, names)
                rows = apply(self.matrix, rows) if turning is None else rows @ turning.T
                moved |= zip(names, rows.T, strict=True)
                finite = rows[np.isfinite(rows).all(axis=1)]
                if names in CORNERS and len(finite):
                    self.ends.extend([finite.min(axis=0), finite.max(axis=0)])
        if there >= {*_ROTATION, _SCALES[0]}:
            moved |= self._move_splats(columns)
        return {name: _fit(values, columns[name].dtype) for name, values in moved.items()}

    def _move_splats(self, columns: Mapping[str, NDArray[np.generic]]) -> dict[str, FloatArray]:
        sizes = [name for name in _SCALES if name in columns]
        moved = dict(zip(sizes, (_table(columns, sizes) + math.log(self.scale)).T, strict=True))
        x, y, z, w = quaternions(self.turning[None])[0]
        product = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
        moved |= zip(_ROTATION, (_table(columns, _ROTATION) @ product.T).T, strict=True)
        count = sum(name.startswith("f_rest_") for name in columns)
        top = math.isqrt(count // 3 + 1) - 1  # degree of the harmonics of three colours
        if count != 3 * ((top + 1) ** 2 - 1):
            self.notes.append(f"f_rest_*: not rotated; {count} coefficients are of no degree")
        elif count:
            names = [f"f_rest_{k}" for k in range(count)]
            colors = _table(columns, names).reshape(-1, 3, count // 3)
            for degree in range(1, top + 1):
                part = slice(degree**2 - 1, (degree + 1) ** 2 - 1)
                colors[:, :, part] = colors[:, :, part] @ rotate_harmonics(self.turning, degree).T
            moved |= zip(names, colors.reshape(-1, count).T, strict=True)
        return moved


def _table(columns: Mapping[str, NDArray[np.generic]], names: Sequence[str]) -> FloatArray:
    return np.stack([np.asarray(columns[name], np.float64) for name in names], axis=1)


def _fit(values: FloatArray, kind: np.dtype[Any]) -> FloatArray:
    """Return numbers that a type can hold."""
    if kind.kind not in "iu":
        return values
    limits = np.iinfo(kind)
    return np.clip(np.rint(values), limits.min, limits.max)


def rotate_harmonics(rotation: FloatArray, degree: int) -> FloatArray:
    """Return Wigner's matrix that rotates coefficients of a degree, in the basis of Gaussian splats."""
    directions = np.random.default_rng(0).normal(size=(4 * degree + 4, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    # The basis after the rotation times new coefficients is that before it times old ones.
    after, before = _basis(directions @ rotation.T, degree), _basis(directions, degree)
    return np.asarray(np.linalg.lstsq(after, before, rcond=None)[0], np.float64)


def _basis(directions: FloatArray, degree: int) -> FloatArray:
    """Return the real harmonics (n,2l+1) of a degree, with the signs of 3D Gaussian splatting."""
    x, y, z = directions.T
    columns: list[FloatArray] = []
    for order in range(-degree, degree + 1):
        k = abs(order)
        share = math.factorial(degree - k) / math.factorial(degree + k) / (1 if k else 2)
        size = (-1) ** k * math.sqrt((2 * degree + 1) / (2 * math.pi) * share)
        around = np.imag((x + 1j * y) ** k) if order < 0 else np.real((x + 1j * y) ** k)
        columns.append(size * Legendre.basis(degree).deriv(k)(z) * around)
    return np.stack(columns, axis=1)
