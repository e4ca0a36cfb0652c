"""Point clouds as shaded pictures, lit from the left, and distances between two clouds for their colours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.values import run_options
from cgroup.features import normals
from cgroup.types import BoolArray, Correspondences, FloatArray, IndexArray

Tint: TypeAlias = tuple[float, float, float]
Extent: TypeAlias = tuple[float, float, float, float]

LIGHT = np.array([-0.45, 0.55, 0.70])  # towards the light: upper left, in front
AMBIENT = 0.35
_AMBIENT_ON_VALUES = 0.75  # light and shadow must not be taken for the value
_CELLS = 240  # along the larger side of a picture, at most
_OUTLIERS = 0.01  # share of the points beyond each side that may be left out ...
_MARGIN = 0.3  # ... if they are farther off than this share of the width of the others
_NEIGHBORS = 16  # points that define the plane about a point
_REACH = 2.5  # resolutions of the matches: largest distance of a counterpart in the other cloud
_SHARE = 0.025  # of the target's deviation from its mean, instead of the resolution where matches have none


@dataclass(frozen=True, eq=False)
class View:
    """Orthographic projection: rows point right, up and towards the viewer."""

    axes: FloatArray

    def project(self, points: FloatArray) -> FloatArray:
        """Return right, up and nearness of each point, (N,3)."""
        return points @ self.axes.T


def face_broadside(points: FloatArray, viewpoint: ArrayLike = (0, 0, 0)) -> View:
    """Return the view along the thinnest direction of a cloud, from the scanner's side."""
    # The y axis of the data points upwards, or z where y points at the viewer.
    center = points.mean(axis=0)
    scatter = (points - center).T @ (points - center)
    towards = np.linalg.eigh(scatter)[1][:, 0]
    if towards @ (np.asarray(viewpoint) - center) < 0:
        towards = -towards
    up = np.array([0.0, 1.0, 0.0] if abs(towards[1]) < 0.8 else [0.0, 0.0, 1.0])
    right = np.cross(up, towards)
    right /= np.linalg.norm(right)
    return View(np.stack([right, np.cross(towards, right), towards]))


@dataclass(frozen=True, eq=False)
class Picture:
    """A shaded picture in the plane of projection."""

    rgba: FloatArray  # (height,width,4), transparent without a point; first row at the bottom
    extent: Extent  # left, right, bottom, top


def shade(projected: FloatArray, tint: Tint) -> Picture:
    """Shade a projected cloud by the slope of its nearest points; the tint is that of lit surfaces."""
    projected = projected[_is_no_outlier(projected)]
    grid = _Grid.over(projected)
    return grid.picture(_light(_surface(projected, grid), grid.cell, np.asarray(tint), AMBIENT))


def paint(projected: FloatArray, values: FloatArray, color_of: Callable[[FloatArray], FloatArray]) -> Picture:
    """Shade a projected cloud in colours of values: the means over the nearest points in and around cells."""
    # The mean is NaN if the values of most of these points are NaN.
    kept = _is_no_outlier(projected)
    projected, values = projected[kept], values[kept]
    grid = _Grid.over(projected)
    depth = _surface(projected, grid)
    column, row = grid.cells_of(projected)
    near, known = projected[:, 2] >= depth[column, row] - 2 * grid.cell, np.isfinite(values)
    total, count, every = (
        _sum_around(column[near], row[near], some[near], grid.shape)
        for some in (np.where(known, values, 0.0), known, np.ones(len(values)))
    )
    mean = np.where(2 * count > every, total / np.maximum(count, 1), np.nan)
    return grid.picture(_light(depth, grid.cell, color_of(mean), _AMBIENT_ON_VALUES))


def _sum_around(
    column: IndexArray, row: IndexArray, values: FloatArray, shape: tuple[int, int]
) -> FloatArray:
    sums = np.zeros(shape)
    np.add.at(sums, (column, row), values)
    return np.nansum([_shift(sums, (i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1)], axis=0)


def find_front(projected: FloatArray) -> BoolArray:
    """Return the mask (N,) of points that are not hidden by nearer ones."""
    return _front_layer(projected, _Grid.over(projected))[1]


def _is_no_outlier(projected: FloatArray) -> BoolArray:
    """Return the mask of points without far outliers, which are common in laser scans."""
    places = projected[:, :2]
    low, high = np.quantile(places, (_OUTLIERS, 1 - _OUTLIERS), axis=0)
    margin = _MARGIN * (high - low)
    return ((places >= low - margin) & (places <= high + margin)).all(axis=1)


@dataclass(frozen=True, eq=False)
class _Grid:
    """Square cells over a projected cloud."""

    low: FloatArray  # (2,), centre of the first cell
    cell: float
    shape: tuple[int, int]

    @classmethod
    def over(cls, projected: FloatArray) -> _Grid:
        low, size = projected[:, :2].min(axis=0), np.ptp(projected[:, :2], axis=0)
        # As fine as the points allow: about two of them in a cell.
        least = 1e-12 * np.abs(projected[:, :2]).max() + 1e-300
        cell = max(size.max() / _CELLS, np.sqrt(2 * size.prod() / len(projected)), least)
        columns, rows = (round(float(side / cell)) + 1 for side in size)
        return cls(low, cell, (columns, rows))

    def cells_of(self, projected: FloatArray) -> IndexArray:
        """Return the column and row of each point's cell, (2,N)."""
        return np.round((projected[:, :2] - self.low) / self.cell).astype(np.int64).T

    def picture(self, rgba: FloatArray) -> Picture:
        left, bottom = self.low - self.cell / 2
        width, height = np.array(self.shape) * self.cell
        return Picture(rgba.transpose(1, 0, 2), (left, left + width, bottom, bottom + height))


def _surface(projected: FloatArray, grid: _Grid) -> FloatArray:
    depth = _range_image(projected, grid)
    for _ in range(2):
        depth = _smooth(depth, jump=3 * grid.cell)
    return depth


def _light(depth: FloatArray, cell: float, tint: FloatArray, ambient: float) -> FloatArray:
    slopes = [_slope(depth, axis) / cell for axis in (0, 1)]
    facing = np.stack([-slopes[0], -slopes[1], np.ones_like(depth)], axis=-1)
    facing /= np.linalg.norm(facing, axis=-1, keepdims=True)
    diffuse = np.clip(facing @ (LIGHT / np.linalg.norm(LIGHT)), 0, 1)
    color = (ambient + (1 - ambient) * diffuse)[..., None] * tint
    return np.concatenate([color, np.isfinite(depth)[..., None]], axis=-1)


def _range_image(projected: FloatArray, grid: _Grid) -> FloatArray:
    """Return the mean nearness of the front layer per cell, NaN for empty cells."""
    (column, row), near = _front_layer(projected, grid)
    total, count = np.zeros((2, *grid.shape))
    np.add.at(total, (column[near], row[near]), projected[near, 2])
    np.add.at(count, (column[near], row[near]), 1)
    with np.errstate(invalid="ignore"):
        return total / count


def _front_layer(projected: FloatArray, grid: _Grid) -> tuple[IndexArray, BoolArray]:
    """Return the column and row of each point's cell, and the mask of the nearest points of cells."""
    column, row = cell = grid.cells_of(projected)
    front = np.full(grid.shape, -np.inf)
    np.maximum.at(front, (column, row), projected[:, 2])
    return cell, projected[:, 2] >= front[column, row] - 2 * grid.cell


def _shift(image: FloatArray, steps: tuple[int, int]) -> FloatArray:
    padded = np.pad(image, 1, constant_values=np.nan)
    i, j = (1 + step for step in steps)
    return padded[i : i + image.shape[0], j : j + image.shape[1]]


def _smooth(depth: FloatArray, jump: float) -> FloatArray:
    """Return the mean over each cell and its neighbours on the same surface; holes of one cell are filled."""
    # A hole is a cell without a point, or with points of the far side of the shape only.
    around = np.stack([_shift(depth, (i, j)) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    nearer = around > np.nan_to_num(depth, nan=-np.inf) + jump
    hole = nearer.sum(axis=0) >= 5  # most of the eight cells around
    center = np.where(hole, _average_where(around, nearer), depth)
    same = np.abs(around - center) <= jump
    return np.where(same.any(axis=0), _average_where(around, same), center)


def _average_where(stack: FloatArray, chosen: BoolArray) -> FloatArray:
    return np.where(chosen, stack, 0).sum(axis=0) / np.maximum(chosen.sum(axis=0), 1)


def _slope(depth: FloatArray, axis: int) -> FloatArray:
    """Return the difference to the neighbour on the same surface, the smaller one of the two sides."""
    step = (1, 0) if axis == 0 else (0, 1)
    ahead = _shift(depth, step) - depth
    behind = depth - _shift(depth, (-step[0], -step[1]))
    both = np.where(np.abs(ahead) <= 2 * np.abs(behind), (ahead + behind) / 2, behind)
    both = np.where(np.abs(behind) > 2 * np.abs(ahead), ahead, both)
    both = np.where(np.isnan(both), np.where(np.isnan(ahead), behind, ahead), both)
    return np.nan_to_num(both)


def color_range(matches: Correspondences, target: FloatArray) -> float:
    """Return the end of the colour scale: the resolution of the matches, 0.4 voxels in `register`."""
    return matches.resolution or _SHARE * float(np.sqrt(target.var(axis=0).sum())) or 1.0


def planes(points: FloatArray) -> FloatArray:
    """(N,3) normal of the plane about each point; zero without a plane."""
    if len(points) <= _NEIGHBORS:
        return np.zeros_like(points)
    return np.nan_to_num(normals(points, neighbors=_NEIGHBORS))


def distances(points: FloatArray, planes: FloatArray, others: FloatArray, end: float) -> FloatArray:
    """(N,) distance of the nearest other point from the plane about each point; NaN without a counterpart."""
    # This is the distance between surfaces; that of points is mostly the distance between samples.
    offsets = _core.nearest(points, others, run_options(), _REACH * end)
    off_plane = np.abs(np.einsum("ij,ij->i", offsets, planes))
    return np.where(planes.any(axis=1), off_plane, np.linalg.norm(offsets, axis=1))


def choose_rows(points: FloatArray, most: int) -> IndexArray:
    """Return the rows of all points, or of `most` random ones if there are more."""
    if len(points) <= most:
        return np.arange(len(points))
    return np.sort(np.random.default_rng(0).choice(len(points), most, replace=False))
