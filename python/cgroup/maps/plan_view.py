"""Align a scan with a map in plan view: walls on walls, open floor on free space."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cgroup import _core
from cgroup._checks.values import run_options
from cgroup._runtime.workers import cached_property
from cgroup.maps import settings
from cgroup.types import FloatArray, IndexArray


class Layers(NamedTuple):
    """Walls and floors of voxels, rotated by `turn` such that the axis is z."""

    turn: FloatArray
    walls: FloatArray
    floors: FloatArray


def find_layers(points: FloatArray, normals: FloatArray, axis: FloatArray | None) -> Layers | None:
    """Find walls and floors of voxels; return None if either has few voxels.

    By default the axis is the main direction of the normals, towards the side with more voxels.
    """
    known = np.isfinite(normals).all(axis=1)
    up = _main_direction(normals[known]) if axis is None else axis
    cosines = np.abs(normals @ up)
    flat, steep = known & (cosines > settings.FLAT), known & (cosines < settings.STEEP)
    if flat.sum() < settings.LEAST_FLAT * known.sum() or steep.sum() < settings.LEAST_WALLS:
        return None
    heights = points @ up
    if axis is None and heights.mean() < np.median(heights[flat]):
        up = -up
    turn = _upright(up)
    return Layers(turn, points[steep] @ turn.T, points[flat] @ turn.T)


def _main_direction(normals: FloatArray) -> FloatArray:
    direction = np.linalg.eigh(normals.T @ normals)[1][:, 2]
    for _ in range(settings.DIRECTION_ROUNDS):
        near = normals[np.abs(normals @ direction) > settings.FLAT]
        if len(near):
            direction = np.linalg.eigh(near.T @ near)[1][:, 2]
    return direction


def _upright(up: FloatArray) -> FloatArray:
    vectors = np.linalg.qr(np.column_stack([up, np.eye(3)]))[0].T
    vectors[0] = up
    turn = vectors[[1, 2, 0]]
    turn[1] = np.cross(up, turn[0])
    return turn


class Disk(NamedTuple):
    """Searched positions of a scan's origin in a map: a disk around a place."""

    middle: FloatArray
    radius: float


class _Outline(NamedTuple):
    """Walls and lowest floor of a scan about its centre, (n,2) each, and the centre, (3,)."""

    walls: FloatArray
    floor: FloatArray
    middle: FloatArray


@dataclass(frozen=True, eq=False)
class PlanView:
    """Plan view of a map, on a grid of one voxel."""

    layers: Layers
    voxel: float

    @cached_property
    def _corner(self) -> FloatArray:
        both = np.concatenate([self.layers.walls, self.layers.floors])[:, :2]
        return both.min(axis=0) - settings.MARGIN * self.voxel

    @cached_property
    def _walls(self) -> NDArray[np.uint8]:
        """2 at walls, 1 beside them; both sizes are multiples of a coarse cell."""
        cells = np.floor((self.layers.walls[:, :2] - self._corner) / self.voxel).astype(np.int64)
        least = (cells.max(axis=0) + 1 + settings.MARGIN).tolist()
        grid = np.zeros([-(-size // settings.COARSE) * settings.COARSE for size in least], np.uint8)
        grid[tuple(cells.T)] = 1
        near = grid.copy()
        for axis in (0, 1):
            near = np.maximum(near, np.maximum(np.roll(near, 1, axis), np.roll(near, -1, axis)))
        return grid + near

    def propose(self, scan: Layers, within: Disk | None, threads: int | None) -> Iterator[FloatArray]:
        """Yield poses of a scan, the best place first: (h,4,4) per place, one per floor."""
        middle = np.concatenate([scan.walls, scan.floors]).mean(axis=0)
        middle[2] = np.median(scan.floors[:, 2])
        lowest = np.abs(scan.floors[:, 2] - middle[2]) < 2 * self.voxel
        outline = _Outline((scan.walls - middle)[:, :2], (scan.floors - middle)[lowest, :2], middle)
        angles, places = self._refine(outline, self._place_coarsely(outline, within, threads), threads)
        left = np.ones(len(angles), dtype=bool)
        while left.any():
            first = int(np.argmax(left))
            yield self._poses_at(angles[first], places[first], middle, scan.turn)
            beside = np.abs((angles - angles[first] + np.pi) % (2 * np.pi) - np.pi) <= settings.TURNED
            left &= ~beside | (np.linalg.norm(places - places[first], axis=1) > settings.APART * self.voxel)

    def _place_coarsely(self, outline: _Outline, within: Disk | None, threads: int | None) -> IndexArray:
        """Place walls and floor on coarse cells at all turns; return turns, rows and columns, (n,3)."""
        turns = np.arange(0, settings.TURNS * settings.TURN_PARTS, settings.TURN_PARTS)
        size = settings.COARSE * self.voxel
        height, width = (count // settings.COARSE for count in self._walls.shape)
        coarse = self._walls.reshape(height, settings.COARSE, width, settings.COARSE).max(axis=(1, 3))
        first, last = np.zeros((len(turns), 2)), np.tile([height, width], (len(turns), 1))
        if within is not None:
            turned = np.array([_turn(angle) @ outline.middle[:2] for angle in _angle(turns)])
            places = (self.layers.turn @ within.middle)[:2] + turned - self._corner
            first = np.floor((places - within.radius) / size).clip(0, last)
            last = np.ceil((places + within.radius) / size).clip(0, last)
        windows = np.column_stack([np.arange(len(turns)), first[:, 0], last[:, 0], first[:, 1], last[:, 1]])
        found = self._place(coarse, size, outline, turns, windows, settings.CLOSELY, threads)
        return found * (settings.TURN_PARTS, settings.COARSE, settings.COARSE)

    def _refine(
        self, outline: _Outline, rough: IndexArray, threads: int | None
    ) -> tuple[FloatArray, FloatArray]:
        """Score placements around coarse ones on fine cells; return angles and places, the best first."""
        near = (rough + np.array([[[-1, 0, 0]], [[0, 0, 0]], [[1, 0, 0]]])).reshape(-1, 3)
        turns, numbers = np.unique(near[:, 0] % (settings.TURNS * settings.TURN_PARTS), return_inverse=True)
        ends = np.array([-1, settings.COARSE + 1])
        sides = [(near[:, [k]] + ends).clip(0, self._walls.shape[k - 1]) for k in (1, 2)]
        windows = np.column_stack([numbers, *sides])
        most = len(windows) * (settings.COARSE + 2) ** 2
        found = self._place(self._walls, self.voxel, outline, turns, windows, most, threads)
        return _angle(turns[found[:, 0]]), self._corner + (found[:, 1:] + 0.5) * self.voxel

    @staticmethod
    def _place(
        grid: NDArray[np.uint8],
        size: float,
        outline: _Outline,
        turns: IndexArray,
        windows: NDArray[Any],
        most: int,
        threads: int | None,
    ) -> IndexArray:
        """Return the best placements in windows, the best first: number of the turn, row, column, (n,3)."""
        angles, options, wanted = _angle(turns), run_options(threads), windows.astype(np.int64)
        walls, floor = outline.walls / size, outline.floor / size
        directions = np.column_stack([np.cos(angles), np.sin(angles)])
        return _core.best_placements(grid, walls, floor, directions, wanted, options, settings.OPEN, most)

    def _poses_at(self, angle: float, place: FloatArray, middle: FloatArray, turn: FloatArray) -> FloatArray:
        """Return the poses at a place: one per floor of the map."""
        floors = self.layers.floors
        away = np.linalg.norm(floors[:, :2] - place, axis=1)
        near = away < max(settings.FLOOR_WITHIN * self.voxel, float(away.min()) + self.voxel)
        heights = floors[near, 2]
        levels = np.floor(heights / (2 * self.voxel))
        storeys, storey_of, counts = np.unique(levels, return_inverse=True, return_counts=True)
        large = np.argsort(-counts)[: settings.MOST_FLOORS]
        around = np.eye(3)
        around[:2, :2] = _turn(angle)
        poses = np.tile(np.eye(4), (len(storeys), 1, 1))
        poses[:, :3, :3] = self.layers.turn.T @ around @ turn
        for storey in large:
            at = np.array([*place, np.median(heights[storey_of == storey])])
            poses[storey, :3, 3] = self.layers.turn.T @ (at - around @ middle)
        return poses[large[counts[large] >= settings.LEAST_FLOOR * counts.max()]]


def _turn(angle: float) -> FloatArray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _angle(part: IndexArray) -> FloatArray:
    return 2 * np.pi * part / (settings.TURNS * settings.TURN_PARTS)
