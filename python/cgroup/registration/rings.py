"""Fill in the surface between the rings of scans with few beams.

A spinning beam describes a cone. All cones of a scanner have one apex and axis. Neighbouring points of a
ring have the same angle to the axis at the apex, which fixes both.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cgroup import _core
from cgroup._checks.arrays import in_double
from cgroup._checks.values import run_options
from cgroup.features import Cloud
from cgroup.registration.scan import Scan
from cgroup.types import FloatArray, IndexArray

_LEAST_RINGS, _MOST_RINGS = 8, 40
_MOST_POINTS = 200_000  # of so few rings
_CHORDS, _FEW = 3000, 4  # from points to those next to them, of which one in so many first
_AWAY = 0.5  # of the cloud's radius, from its middle to the places where the search for the apex starts
_ROUNDS, _LAST_ROUNDS = 12, 15
_CUT, _PER_MEDIAN, _LEAST_DEVIATION, _DAMPING = 4.685, 1.4826, 1e-9, 1e-9  # as for `align`
_ENOUGH = 5000  # points for finding the rings
_APART = 3.0  # gaps between rings over those within them, and over the spacing along them
_STEP = 1.5  # between points that are filled in, in spacings along the ring
_MOST_STEPS = 12
_GRAZING = 0.05  # sine of the angle to the ray (3 degrees) below which rings are of two surfaces


class Rings(NamedTuple):
    """The ring of each point, and its angle about the scanner's axis; rings are sorted by elevation."""

    labels: IndexArray
    around: FloatArray
    upwards: FloatArray
    ranges: FloatArray


def fill_between_rings(scan: Scan) -> Scan:
    """Fill in the surface between the rings of a scan; return other clouds unchanged.

    Neighbouring points of adjacent rings are joined by a line of points, unless it is seen at a grazing
    angle: then the rings lie on two surfaces.
    """
    if scan.faces is not None or scan.normals is not None or len(scan.cloud) > _MOST_POINTS:
        return scan
    points = in_double(scan.cloud.points)
    rings = find_rings(points, scan.axes)
    if rings is None:
        return scan
    parts = [points]
    rows = [np.flatnonzero(rings.labels == label) for label in range(int(rings.labels.max()) + 1)]
    rows = [row[np.argsort(rings.around[row])] for row in rows]
    spacing = 2 * np.pi / float(np.median([len(row) for row in rows]))
    for lower, upper in itertools.pairwise(rows):
        above = _next_to(rings.around[upper], rings.around[lower])
        apart = np.abs(np.mod(rings.around[upper][above] - rings.around[lower] + np.pi, 2 * np.pi) - np.pi)
        low, high = lower[apart < 2 * spacing], upper[above[apart < 2 * spacing]]
        lines = points[high] - points[low]
        lengths = np.linalg.norm(lines, axis=1)
        near = np.minimum(rings.ranges[low], rings.ranges[high])
        seen = near * np.sin(np.abs(rings.upwards[high] - rings.upwards[low])) > _GRAZING * lengths
        low, lines, lengths, near = low[seen], lines[seen], lengths[seen], near[seen]
        steps = np.minimum(np.ceil(lengths / (_STEP * spacing * near)), _MOST_STEPS + 1).astype(int)
        for step in range(1, int(steps.max(initial=1))):
            more = step < steps
            parts.append(points[low[more]] + (step / steps[more])[:, None] * lines[more])
    return replace(scan, cloud=Cloud(np.concatenate(parts), name=scan.name))


def find_rings(points: FloatArray, axes: FloatArray) -> Rings | None:
    """Find the rings of a spinning scanner, each on a cone; None without rings.

    The search starts at places along the cloud's own axes (3,3), and takes the best apex from which the
    angles to the axis fall into groups.
    """
    middle = points.mean(axis=0)
    radius = float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean()))
    if not radius > 0:
        return None
    local = (points - middle) / radius
    in_order = np.argsort(local @ axes[0], kind="stable")  # not that of the rows
    chords = _Chords.of(local, in_order[:: len(local) // _CHORDS + 1].copy())
    if len(chords.ends) < _LEAST_RINGS:
        return None
    some = local[in_order[:: len(local) // _ENOUGH + 1]]
    few = _Chords(*(part[::_FEW] for part in chords))
    axis = chords.axis()
    starts = np.concatenate([np.zeros((1, 3)), _AWAY * axes, -_AWAY * axes])
    found = [few.fit(Apex(place, axis, np.inf), _ROUNDS) for place in starts]
    # Not the best alone: from a position in the ground plane, all ground points have one angle.
    for rough in sorted(found, key=lambda apex: apex.off):
        if _find_borders(some, rough, len(points)) is None:
            continue
        apex = chords.fit(rough, _LAST_ROUNDS)
        apex = apex._replace(axis=apex.axis * (1.0 if ((local @ apex.axis) ** 3).sum() >= 0 else -1.0))
        borders = _find_borders(some, apex, len(points))
        return None if borders is None else _tell(local, apex, borders, radius)
    return None


class Apex(NamedTuple):
    """Position and axis of a scanner, and the deviation of the chords from its cones."""

    place: FloatArray
    axis: FloatArray
    off: float

    def upwards(self, points: FloatArray) -> FloatArray:
        """Return the elevation angles of points about the axis."""
        rays = points - self.place
        ranges = np.maximum(np.linalg.norm(rays, axis=1), np.finfo(float).tiny)
        return np.arcsin(np.clip(rays @ self.axis / ranges, -1, 1))


class _Chords(NamedTuple):
    """Lines between neighbouring points, mostly along the rings: both ends, (n,3)."""

    ends: FloatArray
    others: FloatArray

    @classmethod
    def of(cls, points: FloatArray, rows: IndexArray) -> _Chords:
        """Return the chords from some of the points."""
        near = points[_core.nearest_rows(points, rows, run_options(1), 2)[:, -1]]
        apart = (near != points[rows]).any(axis=1)
        return cls(points[rows][apart], near[apart])

    def axis(self) -> FloatArray:
        """Return the direction perpendicular to the chords, without outliers."""
        along = self.others - self.ends
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        axis = np.linalg.eigh(along.T @ along)[1][:, 0]
        for _ in range(5):
            off = np.abs(along @ axis)
            kept = along[off <= max(2.5 * float(np.median(off)), 1e-3)]
            axis = np.linalg.eigh(kept.T @ kept)[1][:, 0]
        return axis

    def fit(self, apex: Apex, rounds: int) -> Apex:
        """Fit apex and axis by Tukey's weights, so that both ends of each chord have the same elevation.

        The residual is the angle between the chord and the cone of its ends: ``(sin b - sin a) r / length``.
        """
        lengths = np.linalg.norm(self.others - self.ends, axis=1)
        for _ in range(rounds):
            (u, r), (v, q) = (_rays_from(apex.place, ends) for ends in self)
            sines, others, scale = u @ apex.axis, v @ apex.axis, (r + q) / 2 / lengths
            residuals = (others - sines) * scale
            off = _PER_MEDIAN * float(np.median(np.abs(residuals))) + _LEAST_DEVIATION
            weights = np.maximum(1 - (residuals / (_CUT * off)) ** 2, 0) * scale
            aside = np.linalg.svd(apex.axis[None])[2][1:]
            by_place = (apex.axis - sines[:, None] * u) / r[:, None]
            by_place -= (apex.axis - others[:, None] * v) / q[:, None]
            rows = weights[:, None] * np.hstack([by_place, (v - u) @ aside.T])
            matrix = rows.T @ rows
            damped = matrix + (_DAMPING * np.trace(matrix) + np.finfo(float).tiny) * np.eye(5)
            change = -np.linalg.solve(damped, rows.T @ (weights * (others - sines)))
            change *= min(1.0, _AWAY / max(float(np.linalg.norm(change[:3])), np.finfo(float).tiny))
            axis = apex.axis + change[3:] @ aside
            apex = Apex(apex.place + change[:3], axis / np.linalg.norm(axis), off)
        return apex


def _rays_from(place: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    rays = points - place
    ranges = np.maximum(np.linalg.norm(rays, axis=1), np.finfo(float).tiny)
    return rays / ranges[:, None], ranges


def _find_borders(some: FloatArray, apex: Apex, count: int) -> FloatArray | None:
    """Return the angles between the rings of some of the points; None without rings."""
    ordered = np.sort(apex.upwards(some))
    gaps = np.diff(ordered)
    largest = np.sort(gaps)[::-1][: _MOST_RINGS + 1]
    if len(largest) <= _LEAST_RINGS:
        return None
    falls = largest[_LEAST_RINGS - 2 : -1] / np.maximum(largest[_LEAST_RINGS - 1 :], np.finfo(float).tiny)
    rings = int(np.argmax(falls)) + _LEAST_RINGS
    spacing = 2 * np.pi * rings / count
    if falls.max() < _APART or largest[rings - 2] < _APART * spacing:
        return None
    between = np.flatnonzero(gaps >= largest[rings - 2])
    return (ordered[between] + ordered[between + 1]) / 2


def _tell(local: FloatArray, apex: Apex, borders: FloatArray, radius: float) -> Rings:
    """Return the rings of points in units of the cloud's radius."""
    upwards = apex.upwards(local)
    rays = local - apex.place
    aside = np.linalg.svd(apex.axis[None])[2][1:]  # two directions at right angles to the axis
    around = np.arctan2(*(rays @ aside.T).T)
    ranges = radius * np.linalg.norm(rays, axis=1)
    return Rings(np.searchsorted(borders, upwards), around, upwards, ranges)


def _next_to(ring: FloatArray, angles: FloatArray) -> IndexArray:
    """Return the row of the ring point nearest to each angle; rows ascend by angle."""
    turned = np.concatenate([ring[-1:] - 2 * np.pi, ring, ring[:1] + 2 * np.pi])
    after = np.clip(np.searchsorted(turned, angles), 1, len(turned) - 1)
    nearest = np.where(angles - turned[after - 1] < turned[after] - angles, after - 1, after)
    return (nearest - 1) % len(ring)
