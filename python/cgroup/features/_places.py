"""Clouds of which points repeat: the front end computes on one point per place."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cgroup import _core
from cgroup.errors import InputError
from cgroup.types import IndexArray, RealArray

Value = TypeVar("Value", bound=np.generic)

_MANY = 200_000  # points of which a part shows whether they repeat
_HASH = np.uint64(0x9E3779B97F4A7C15), np.uint64(29)


@dataclass(frozen=True, eq=False)
class Places:
    """One point for each place of a cloud, and the way back to the points as given."""

    core: _core.Cloud  # of the first point of each place, in the order of the cloud
    # (M,), row of each of them in the cloud; None where no two points coincide
    first: IndexArray | None = None
    rows: IndexArray | None = None  # (N,), place of each point of the cloud; None where no two coincide

    def keypoints(self, rows: IndexArray) -> IndexArray:
        """Return the places of rows of the cloud."""
        if self.rows is None:  # the core checks them
            return rows
        wrong = np.flatnonzero(rows >= len(self.rows))
        if len(wrong):
            got = f"index {rows[wrong[0]]} in row {wrong[0]}"
            raise InputError("keypoints", got, f"the cloud has {len(self.rows)} points")
        return self.rows[rows]

    def normals(self, given: RealArray) -> RealArray:
        """Return the normal of each place: of its points the first that has one."""
        if self.first is None or self.rows is None:  # the core checks their number
            return given
        if len(given) != len(self.rows):
            raise InputError("normals", f"{len(given)} rows", f"give {len(self.rows)}, one per point")
        chosen = self.first.copy()
        known = np.flatnonzero(np.isfinite(given).all(axis=1))[::-1]
        chosen[self.rows[known]] = known
        return given[chosen]

    def spread(self, values: NDArray[Value]) -> NDArray[Value]:
        """Return the value of each point of the cloud from those of the places."""
        return values if self.rows is None else values[self.rows]

    def first_rows(self, places: IndexArray) -> IndexArray:
        """Return the row of the first point at each of these places, ascending as they are."""
        return places if self.first is None else self.first[places]


def find_distinct(points: RealArray) -> IndexArray | None:
    """Return the first row of each distinct point, ascending; None where no two coincide."""
    keys = np.zeros(len(points), dtype=np.uint64)
    multiplier, shift = _HASH
    bits = np.dtype(f"u{points.dtype.itemsize}")
    for axis in range(3):
        keys += np.ascontiguousarray(points[:, axis] + points.dtype.type(0)).view(bits)  # -0 is 0
        keys *= multiplier
        keys ^= keys >> shift
    # Of many points one in eight: equal ones have equal keys.
    ordered = np.sort(keys if len(keys) <= _MANY else keys[keys % 8 == 0])
    if (ordered[1:] != ordered[:-1]).all():
        return None
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    if (points[first][inverse.reshape(-1)] != points).any():  # two points with the same key
        first = np.unique(points, axis=0, return_index=True)[1]
    return None if len(first) == len(points) else np.sort(first)


def renumber(points: RealArray, first: IndexArray) -> IndexArray:
    """Return the row of each point among the distinct ones."""
    place = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1)
    rows = np.empty(len(first), dtype=np.int64)
    rows[place[first]] = np.arange(len(first))
    return rows[place]
