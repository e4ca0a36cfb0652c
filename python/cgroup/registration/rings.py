"""Scans of few beams: the surface between their rings is filled in."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup._checks.arrays import in_double
from cgroup.features import Cloud

if TYPE_CHECKING:
    from cgroup.registration.scan import Scan
    from cgroup.types import FloatArray, IndexArray

_LEAST_RINGS, _MOST_RINGS = 8, 40
_MOST_POINTS = 200_000  # of so few rings
_DIRECTIONS, _ROUNDS = 40, 5
_ENOUGH = 5000  # points that tell the rings
_APART = 3.0  # gaps between rings over those within them, and over the spacing along them
_STEP = 1.5  # between points that are filled in, in spacings along the ring
_MOST_STEPS = 12
_GRAZING = 0.05  # sine of the angle to the ray (3 degrees) below which rings are of two surfaces


class Rings(NamedTuple):
    """The ring of each point, and its angle about the axis of the scanner; the rings from below upwards."""

    labels: IndexArray
    around: FloatArray
    upwards: FloatArray
    ranges: FloatArray


def fill_between_rings(scan: Scan, eye: tuple[float, float, float]) -> Scan:
    """Fill in the surface between the rings of a scan; any other cloud is left as it is.

    Points next to each other on adjacent rings are joined by points in a line, unless the line is seen at a
    grazing angle: then the two rings lie on two surfaces, one before the other.
    """
    if scan.faces is not None or scan.normals is not None or len(scan.cloud) > _MOST_POINTS:
        return scan
    points = in_double(scan.cloud.points)
    rings = find_rings(points - eye)
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


def find_rings(rays: FloatArray) -> Rings | None:
    """Tell the rings that a spinning scanner's rays lie on, each on a cone; None where there are none.

    The axis is at right angles to the directions from rays to their neighbours, since points are closest
    along the rings. Angles to it then fall into groups.
    """
    ranges = np.linalg.norm(rays, axis=1)
    directions = rays / np.maximum(ranges, np.finfo(float).tiny)[:, None]
    axis = _axis_of(directions[:: len(rays) // _DIRECTIONS + 1], directions)
    sines = np.clip(directions @ axis, -1, 1)
    ordered = np.sort(np.arcsin(sines[:: len(rays) // _ENOUGH + 1]))
    gaps = np.diff(ordered)
    largest = np.sort(gaps)[::-1][: _MOST_RINGS + 1]
    if len(largest) <= _LEAST_RINGS:
        return None
    falls = largest[_LEAST_RINGS - 2 : -1] / np.maximum(largest[_LEAST_RINGS - 1 :], np.finfo(float).tiny)
    count = int(np.argmax(falls)) + _LEAST_RINGS - 1
    spacing = 2 * np.pi * (count + 1) / len(rays)
    if falls.max() < _APART or largest[count - 1] < _APART * spacing:
        return None
    between = np.flatnonzero(gaps >= largest[count - 1])
    upwards = np.arcsin(sines)
    labels = np.searchsorted((ordered[between] + ordered[between + 1]) / 2, upwards)
    aside = np.linalg.svd(axis[None])[2][1:]  # two directions at right angles to the axis
    around = np.arctan2(*(directions @ aside.T).T)
    return Rings(labels, around, upwards, ranges)


def _axis_of(some: FloatArray, directions: FloatArray) -> FloatArray:
    """Direction at right angles to those from each of some rays to its neighbour; outliers don't count."""
    cosines = some @ directions.T
    cosines[cosines > 1 - 1e-12] = -1  # the ray itself, and others in its direction
    along = directions[np.argmax(cosines, axis=1)] - some
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), np.finfo(float).tiny)
    axis = np.linalg.eigh(along.T @ along)[1][:, 0]
    for _ in range(_ROUNDS):
        off = np.abs(along @ axis)
        kept = along[off <= max(2.5 * float(np.median(off)), 1e-3)]
        axis = np.linalg.eigh(kept.T @ kept)[1][:, 0]
    return axis


def _next_to(ring: FloatArray, angles: FloatArray) -> IndexArray:
    """Row of a ring's points, in order of their angle, that is nearest to each angle."""
    turned = np.concatenate([ring[-1:] - 2 * np.pi, ring, ring[:1] + 2 * np.pi])
    after = np.clip(np.searchsorted(turned, angles), 1, len(turned) - 1)
    nearest = np.where(angles - turned[after - 1] < turned[after] - angles, after - 1, after)
    return (nearest - 1) % len(ring)
