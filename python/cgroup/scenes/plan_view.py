"""Where a scan fits a map as seen from above: walls on walls, open floor where the map has no walls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from cgroup._runtime.cached import cached_property
from cgroup._runtime.workers import count_workers, work_side_by_side

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from cgroup.types import FloatArray, IndexArray

_FLAT, _STEEP = 0.9, 0.3  # cosines of normals with the axis: of floors from, of walls up to
_LEAST_FLAT, _LEAST_WALLS = 0.15, 30  # share of flat voxels, and number of wall voxels, that a plan needs
_TURNS, _PARTS = 72, 3  # turns that are tried, and parts of them when it is looked at closely
_COARSE = 2  # voxels of a coarse cell
_OPEN, _BESIDE = 0.7, 0.5  # weight of open floor; what a cell next to a wall counts
_CLOSELY = 300  # placements that are looked at closely
_ROUNDS = 5  # of finding the direction that most normals have
_MARGIN = 2  # cells between a map and the border
_APART, _TURNED = 3.0, np.radians(17.0)  # voxels or angle between places
_FLOOR_WITHIN = 10.0  # voxels from a place
_LEAST_FLOOR, _MOST_FLOORS = 0.2, 4  # share of the largest floor's voxels that another has


class Layers(NamedTuple):
    """Walls and floors of voxels, upright: turned by `turn` such that the axis is z."""

    turn: FloatArray
    walls: FloatArray
    floors: FloatArray


def find_layers(points: FloatArray, normals: FloatArray, axis: FloatArray | None) -> Layers | None:
    """Find walls and floors of voxels; None where there are few of either.

    The axis is that of most normals, unless one is given, and points to where more is.
    """
    known = np.isfinite(normals).all(axis=1)
    up = _main_direction(normals[known]) if axis is None else axis
    cosines = np.abs(normals @ up)
    flat, steep = known & (cosines > _FLAT), known & (cosines < _STEEP)
    if flat.sum() < _LEAST_FLAT * known.sum() or steep.sum() < _LEAST_WALLS:
        return None
    heights = points @ up
    if axis is None and heights.mean() < np.median(heights[flat]):
        up = -up
    turn = _upright(up)
    return Layers(turn, points[steep] @ turn.T, points[flat] @ turn.T)


def _main_direction(normals: FloatArray) -> FloatArray:
    """Return the direction that most normals have."""
    direction = np.linalg.eigh(normals.T @ normals)[1][:, 2]
    for _ in range(_ROUNDS):
        near = normals[np.abs(normals @ direction) > _FLAT]
        if len(near):
            direction = np.linalg.eigh(near.T @ near)[1][:, 2]
    return direction


def _upright(up: FloatArray) -> FloatArray:
    """Return a rotation that takes a direction to z."""
    vectors = np.linalg.qr(np.column_stack([up, np.eye(3)]))[0].T
    vectors[0] = up
    turn = vectors[[1, 2, 0]]
    turn[1] = np.cross(up, turn[0])
    return turn


class _Outline(NamedTuple):
    """Walls and lowest floor of a scan about its middle, from above, (n,2) each."""

    walls: FloatArray
    floor: FloatArray
    radius: float

    def reach(self, size: float) -> int:
        """Return how far it reaches, in cells."""
        return int(self.radius / size) + 1

    def stamp(self, part: int, size: float) -> list[tuple[IndexArray, float]]:
        """Return the cells of open floor and then of walls, (n,2), once turned, and what each counts."""
        turned, reach = _turn(_angle(part)), self.reach(size)
        floor, walls = (
            _different(np.floor(each @ turned.T / size + 0.5).astype(np.int64), reach)
            for each in (self.floor, self.walls)
        )
        return [(floor, -_OPEN / max(len(floor), 1)), (walls, 1.0 / len(walls))]


class _Rough(NamedTuple):
    """A placement on coarse cells: its score, turn, and the cell of the scan's middle."""

    score: float
    number: int
    row: int
    column: int


@dataclass(frozen=True, eq=False)
class PlanView:
    """A map as seen from above, on a grid of one voxel."""

    layers: Layers
    voxel: float

    @cached_property
    def _corner(self) -> FloatArray:
        both = np.concatenate([self.layers.walls, self.layers.floors])[:, :2]
        return both.min(axis=0) - _MARGIN * self.voxel

    @cached_property
    def _walls(self) -> NDArray[np.float32]:
        """1 at walls, 0.5 beside them; both sizes are multiples of a coarse cell."""
        cells = np.floor((self.layers.walls[:, :2] - self._corner) / self.voxel).astype(np.int64)
        least = (cells.max(axis=0) + 1 + _MARGIN).tolist()
        grid = np.zeros([-(-size // _COARSE) * _COARSE for size in least], np.float32)
        grid[tuple(cells.T)] = 1.0
        near = grid.copy()
        for axis in (0, 1):
            near = np.maximum(near, np.maximum(np.roll(near, 1, axis), np.roll(near, -1, axis)))
        return np.maximum(grid, _BESIDE * near)

    def propose(self, scan: Layers, most: int, threads: int | None) -> list[FloatArray]:
        """Propose poses of a scan, the best place first: for each (h,4,4), one for each floor there."""
        middle = np.concatenate([scan.walls, scan.floors]).mean(axis=0)
        middle[2] = np.median(scan.floors[:, 2])
        lowest = np.abs(scan.floors[:, 2] - middle[2]) < 2 * self.voxel
        parts = (scan.walls - middle)[:, :2], (scan.floors - middle)[lowest, :2]
        radius = float(np.linalg.norm(np.concatenate(parts), axis=1).max())
        outline = _Outline(*parts, radius)
        angles, places = self._look_closely(outline, self._place_roughly(outline, threads))
        left = np.ones(len(angles), dtype=bool)
        found: list[FloatArray] = []
        while left.any() and len(found) < most:
            first = int(np.argmax(left))
            found.append(self._poses_at(angles[first], places[first], middle, scan.turn))
            beside = np.abs((angles - angles[first] + np.pi) % (2 * np.pi) - np.pi) <= _TURNED
            left &= ~beside | (np.linalg.norm(places - places[first], axis=1) > _APART * self.voxel)
        return found

    def _place_roughly(self, outline: _Outline, threads: int | None) -> list[_Rough]:
        """Correlate walls and floor with the map on coarse cells, at all turns."""
        height, width = (size // _COARSE for size in self._walls.shape)
        coarse = self._walls.reshape(height, _COARSE, width, _COARSE).max(axis=(1, 3))
        reach = outline.reach(_COARSE * self.voxel)
        shape = tuple(_fast_size(size + reach + 1) for size in coarse.shape)
        spectrum = np.fft.rfft2(coarse, shape)
        most = min(_CLOSELY, coarse.size)

        def correlate(number: int, stop_with_the_others: Callable[[], None]) -> list[_Rough]:
            stop_with_the_others()
            kernel = np.zeros(shape, np.float32)
            for cells, weight in outline.stamp(number * _PARTS, _COARSE * self.voxel):
                kernel[tuple(cells.T)] = weight  # negative cells lie beyond the far end
            scores = np.fft.irfft2(spectrum * np.conj(np.fft.rfft2(kernel)), shape)[:height, :width]
            best = np.argpartition(scores.ravel(), -most)[-most:]
            places = np.stack(np.unravel_index(best, scores.shape), axis=1).tolist()
            return [
                _Rough(score, number, *place)
                for score, place in zip(scores.ravel()[best].tolist(), places, strict=True)
            ]

        found = work_side_by_side(range(_TURNS), correlate, count_workers(threads))
        return sorted((one for some in found for one in some), reverse=True)[:_CLOSELY]

    def _look_closely(self, outline: _Outline, rough: list[_Rough]) -> tuple[FloatArray, FloatArray]:
        """Score placements around rough ones on fine cells; return angles and places, the best first."""
        steps = np.arange(-1, _COARSE + 1)
        shifts = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)
        by_part: dict[int, list[tuple[int, int]]] = {}
        for _, number, row, column in rough:
            for part in (-1, 0, 1):
                turned = (number * _PARTS + part) % (_TURNS * _PARTS)
                by_part.setdefault(turned, []).append((row * _COARSE, column * _COARSE))
        border = outline.reach(self.voxel) + 2
        padded = np.pad(self._walls, border)
        flat, width = padded.ravel(), padded.shape[1]
        cells = [(np.array(some)[:, None] + shifts).reshape(-1, 2) for some in by_part.values()]
        scores: list[FloatArray] = []
        for part, some in zip(by_part, cells, strict=True):
            first = ((some + border) @ (width, 1))[:, None]
            stamps = outline.stamp(part, self.voxel)
            scores.append(
                np.sum(
                    [weight * flat[first + each @ (width, 1)].sum(axis=1) for each, weight in stamps], axis=0
                )
            )
        order = np.argsort(-np.concatenate(scores), kind="stable")
        angles = np.repeat([_angle(part) for part in by_part], [len(some) for some in cells])
        return angles[order], self._corner + (np.concatenate(cells)[order] + 0.5) * self.voxel

    def _poses_at(
        self, angle: float, place: FloatArray, middle: FloatArray, scan_turn: FloatArray
    ) -> FloatArray:
        """Return the poses at a place: one for each floor of the map there."""
        floors = self.layers.floors
        away = np.linalg.norm(floors[:, :2] - place, axis=1)
        near = away < max(_FLOOR_WITHIN * self.voxel, float(away.min()) + self.voxel)
        heights = floors[near, 2]
        storeys, storey_of, counts = np.unique(
            np.floor(heights / (2 * self.voxel)), return_inverse=True, return_counts=True
        )
        large = np.argsort(-counts)[:_MOST_FLOORS]
        around = np.eye(3)
        around[:2, :2] = _turn(angle)
        poses = np.tile(np.eye(4), (len(storeys), 1, 1))
        poses[:, :3, :3] = self.layers.turn.T @ around @ scan_turn
        for storey in large:
            at = np.array([*place, np.median(heights[storey_of == storey])])
            poses[storey, :3, 3] = self.layers.turn.T @ (at - around @ middle)
        return poses[large[counts[large] >= _LEAST_FLOOR * counts.max()]]


def _turn(angle: float) -> FloatArray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _angle(part: int) -> float:
    return 2 * np.pi * part / (_TURNS * _PARTS)


def _different(cells: IndexArray, reach: int) -> IndexArray:
    """Return each cell once, of cells (n,2) no farther than so from the origin."""
    width = 2 * reach + 1
    return np.stack(np.divmod(np.unique((cells + reach) @ (width, 1)), width), axis=1) - reach


def _fast_size(least: int) -> int:
    """Return a size of no prime factors but 2, 3 and 5."""
    size = least
    while True:
        left = size
        for factor in (2, 3, 5):
            while left % factor == 0:
                left //= factor
        if left == 1:
            return size
        size += 1
