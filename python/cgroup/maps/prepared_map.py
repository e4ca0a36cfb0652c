"""Large maps, described once for locating scans."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from cgroup import _core, features
from cgroup._checks.arrays import in_double
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_length, as_path, as_threads, run_options
from cgroup._runtime.memory import report_refused_memory
from cgroup._runtime.progress import as_stage_function
from cgroup.errors import InputError
from cgroup.features import Cloud
from cgroup.features.voxels import thin
from cgroup.fronts.scan import Scan, as_scan, as_surface, without_outliers
from cgroup.maps import settings
from cgroup.maps.map_files import load_arrays, not_a_map, save_arrays
from cgroup.maps.plan_view import PlanView, find_layers
from cgroup.registration import DenseFront, PreparedScan
from cgroup.registration.pairwise import LEAST_VOXELS, Preparation
from cgroup.types import AnyCloud, FloatArray, IndexArray, PointCloud, RealArray

_NOT_DESCRIBED = 1e9  # squared length in place of that of a descriptor
_ARRAYS = "points", "voxels", "normals", "frames", "descriptors", "cells", "voxel_ends", "point_ends"


@runtime_checkable
class Mergeable(Protocol):
    """Interface of `Scene`, which this package does not import."""

    @property
    def components(self) -> object:
        """Return the components; a result of `register` has none."""
        ...

    def merged(self) -> PointCloud:
        """Return one cloud."""
        ...


@dataclass(frozen=True, eq=False)
class Level:
    """A map at one voxel. Rows of voxels and points are ordered by their cell."""

    voxel: float  # edge length of the voxels
    points: FloatArray  # (N,3), the map, a point in each third of a voxel
    voxels: FloatArray  # (M,3)
    normals: FloatArray  # (M,3), to the side of the frames' z axis
    frames: FloatArray  # (M,3,3)
    descriptors: NDArray[np.float32]  # (M,34), FPFH, and its squared length
    cells: FloatArray  # (C,3), middles of the cells that are not empty
    voxel_ends: IndexArray  # (C,), rows where those of each cell end
    point_ends: IndexArray
    _plans: dict[tuple[float, ...] | None, PlanView | None] = field(default_factory=dict, init=False)
    _neighbors: dict[float, IndexArray] = field(default_factory=dict, init=False)

    def plan(self, axis: FloatArray | None) -> PlanView | None:
        """Return the plan view of the map, computed once per axis; None without walls or floors."""
        key = None if axis is None else tuple(axis.tolist())
        if key not in self._plans:
            layers = find_layers(self.voxels, self.normals, axis)
            self._plans[key] = None if layers is None else PlanView(layers, self.voxel)
        return self._plans[key]

    def around(self, middle: FloatArray, radius: float) -> IndexArray:
        """Return the cells whose centres are within a radius of a place."""
        with np.errstate(over="ignore"):
            return np.flatnonzero(((self.cells - middle) ** 2).sum(axis=1) <= np.square(radius))

    def count(self, cells: IndexArray) -> int:
        """Count the voxels in some cells."""
        return int(np.diff(self.voxel_ends, prepend=0)[cells].sum())

    def crop(self, cells: IndexArray, threads: int | None) -> PreparedScan:
        """Return the content of some cells as a scan."""
        rows, points = _rows_of(cells, self.voxel_ends), _rows_of(cells, self.point_ends)
        cloud = Cloud(self.points[points], name="place")
        scan = Scan(cloud, None, None, "place", cloud.points)
        known = np.flatnonzero(self.descriptors[rows, -1] < _NOT_DESCRIBED)
        described = known.tolist(), self.frames[rows[known]], self.descriptors[rows[known], :-1]
        voxels = self.voxels[rows], self.normals[rows]
        core = _core.Prepared.of_parts(scan.core, self.voxel, voxels, described, run_options(threads))
        return PreparedScan(scan, DenseFront(), self.voxel, None, True, threads, core)  # noqa: FBT003 - a field

    def compare(self, descriptors: NDArray[np.float32], radius: float) -> FloatArray:
        """Return the distance of descriptors to those within a radius of each cell, (C,).

        The mean over the descriptors of their distance to the nearest one there, as a multiple of the median
        over all cells, and 1 at most (after O. Boiman, E. Shechtman and M. Irani, *In defense of
        nearest-neighbor based image classification*, CVPR 2008).
        """
        wanted = np.concatenate([-2 * descriptors, np.ones((len(descriptors), 1), np.float32)], axis=1).T
        nearest = np.empty((len(self.cells), len(descriptors)), np.float32)
        starts = np.concatenate([[0], self.voxel_ends])
        for first, last in _batches(self.voxel_ends, settings.AT_ONCE):
            squares = self.descriptors[starts[first] : starts[last]] @ wanted
            for cell in range(first, last):  # np.minimum.reduceat takes ten times as long
                some = squares[starts[cell] - starts[first] : starts[cell + 1] - starts[first]]
                some.min(axis=0, out=nearest[cell])
        nearest += (descriptors**2).sum(axis=1)
        np.sqrt(np.maximum(nearest, 0, out=nearest), out=nearest)
        beside, found = self._beside(radius), np.empty_like(nearest)
        size = max(settings.AT_ONCE // beside.shape[1], 1)
        for first in range(0, len(beside), size):
            found[first : first + size] = nearest[beside[first : first + size]].min(axis=1)
        found /= np.maximum(np.median(found, axis=0), 1e-6)
        return np.minimum(found, 1.0).mean(axis=1)

    def _beside(self, radius: float) -> IndexArray:
        """Return the cells within a radius of each cell, (C,k), padded with the cell itself."""
        steps = round(settings.CELL_PARTS * radius / (settings.CELL * self.voxel)) / settings.CELL_PARTS
        if steps not in self._neighbors:
            reach = np.arange(-int(steps), int(steps) + 1)
            offsets = np.stack(np.meshgrid(reach, reach, reach, indexing="ij"), axis=-1).reshape(-1, 3)
            offsets = offsets[(offsets**2).sum(axis=1) <= steps**2]
            places: IndexArray = np.rint(self.cells / (settings.CELL * self.voxel) - 0.5).astype(np.int64)
            places -= places.min(axis=0) - int(steps)
            shape = places.max(axis=0) + int(steps) + 1
            numbers = np.asarray(np.ravel_multi_index(tuple(places.T), shape))
            wanted = np.ravel_multi_index(tuple(np.moveaxis(places[:, None] + offsets, 2, 0)), shape)
            rows = np.minimum(np.searchsorted(numbers, wanted), len(self.cells) - 1)
            own = np.arange(len(self.cells))[:, None]
            self._neighbors[steps] = np.where(np.take(numbers, rows) == wanted, rows, own)
        return self._neighbors[steps]


@dataclass(frozen=True, eq=False)
class PreparedMap:
    """A map prepared by `prepare_map` for `locate`.

    It is described at voxels of several sizes, each larger than the one before by the square root of 2; a
    scan is located at the most suitable one. It can be pickled; `save` writes it to a folder.

    Attributes
    ----------
    points : (N,3) array of float
        The whole cloud.
    levels : list of Level
        The map at each voxel, the finest first.
    voxel : float or None
        The requested voxel, or None.
    threads : int or None
        Number of threads.
    """

    points: RealArray
    levels: list[Level]
    voxel: float | None = None
    threads: int | None = None

    def add(self, cloud: Cloud | AnyCloud) -> PreparedMap:
        """Return the map with a further cloud; this takes as long as preparing both.

        Parameters
        ----------
        cloud : PointCloud, Cloud, path or (N,3) array_like of float
            In the frame of the map.

        Returns
        -------
        PreparedMap
            A new one.
        """
        points = np.concatenate([self.points, as_surface("cloud", cloud).cloud.points])
        return prepare_map(points, voxel=self.voxel, threads=self.threads)

    def level_at(self, voxel: float, finer: int = 0) -> Level:
        """Return the level nearest to a voxel, or the one finer by some.

        :meta private:
        """
        row = int(np.argmin([abs(np.log(level.voxel / voxel)) for level in self.levels]))
        return self.levels[max(row - finer, 0)]

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Write the map to a new folder, for `PreparedMap.load`.

        Parameters
        ----------
        folder : path
            A new folder, for ``map.json`` and arrays in NumPy's format.
        """
        arrays = {"points": self.points}
        for row, level in enumerate(self.levels):
            arrays |= {f"{row}-{name}": getattr(level, name) for name in _ARRAYS}
        facts = {"voxel": self.voxel, "voxels": [level.voxel for level in self.levels]}
        save_arrays(as_path("folder", folder), facts, arrays)

    @staticmethod
    @report_refused_memory()
    def load(folder: str | os.PathLike[str], *, threads: int | None = None) -> PreparedMap:
        """Read a map that `save` wrote into memory, and compare its checksums.

        Parameters
        ----------
        folder : path
            Made by `save`.
        threads : int, optional
            As for `register`.

        Returns
        -------
        PreparedMap
            The saved map; later changes of the folder do not change it.
        """
        folder = as_path("folder", folder)
        facts, arrays = load_arrays(folder)
        try:
            levels = [
                Level(float(voxel), *(arrays[f"{row}-{name}"] for name in _ARRAYS))
                for row, voxel in enumerate(facts["voxels"])
            ]
            return PreparedMap(arrays["points"], levels, facts["voxel"], as_threads(threads))
        except (KeyError, TypeError) as error:
            raise not_a_map(folder, error) from error

    def __repr__(self) -> str:
        finest = self.levels[0]
        voxels = f"voxels={len(finest.voxels)}, voxel={finest.voxel:.4g}"
        return f"PreparedMap(points={len(self.points)}, {voxels})"


@report_refused_memory()
@explain_wrong_calls
def prepare_map(
    cloud: Cloud | AnyCloud | Mergeable,
    *,
    voxel: float | None = None,
    threads: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> PreparedMap:
    """Prepare a map in which any number of scans can be located.

    A map of ten million points takes about 2 GB: 0.8 kB per voxel of the finest level, and its points.
    `threads` and `progress` are as for `register`.

    Parameters
    ----------
    cloud : PointCloud, Cloud, path, (N,3) array_like of float or Scene
        In one frame; of a scene the largest component.
    voxel : float, optional
        Edge length of the voxels, in the unit of the points. By default the map is described at voxels from
        four times its point spacing upwards, so that scans of any size can be located.

    Returns
    -------
    PreparedMap
        For `locate`.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.scenes import locate, prepare_map
    >>> pair = standin_pair()
    >>> locate(pair.source, prepare_map(pair.target))[0].ok
    True
    """
    begin = as_stage_function(progress)
    begin("points")
    surface = as_surface("cloud", cloud.merged() if isinstance(cloud, Mergeable) else cloud)
    if voxel is not None:
        size = as_length("voxel", voxel)
        given = without_outliers(surface.sampled(size)).cloud
        return PreparedMap(given.points, [_describe(given, size, threads, begin)], size, threads)
    given = without_outliers(surface).cloud
    size = settings.SPACINGS * features.resolution(given, threads=threads)
    levels = [_describe(given, size, threads, begin)]
    with suppress(InputError):  # of voxels too coarse for planes
        while len(levels[-1].voxels) > settings.COARSEST:
            size *= settings.STEP
            levels.append(_describe(given, size, threads, begin))
    return PreparedMap(given.points, levels, threads=threads)


def _describe(cloud: Cloud, voxel: float, threads: int | None, begin: Callable[[str], Any]) -> Level:
    begin(f"voxels of {voxel:.4g}")
    thinned = features.voxel_downsample(cloud, settings.BETWEEN_POINTS * voxel, threads=threads)
    if len(thinned) < LEAST_VOXELS:
        left = f"{voxel:.4g}, which leaves {len(thinned)} points of a map that is {cloud.diagonal:.4g} across"
        raise InputError("voxel", left, "give a smaller one, or a map of more points")
    shared = Preparation(voxel, DenseFront(), threads)
    made = shared.prepare(as_scan("cloud", thinned.points), None, by_frames=True, most=2**31)
    described, voxels = made.described, thin(made.scan.cloud, voxel, threads=threads)
    frames = np.full((len(voxels), 3, 3), np.nan)
    frames[described.indices] = described.lrf
    descriptors = np.zeros((len(voxels), described.descriptors.shape[1] + 1), np.float32)
    descriptors[:, -1] = _NOT_DESCRIBED
    descriptors[described.indices, :-1] = described.descriptors
    descriptors[described.indices, -1] = (described.descriptors**2).sum(axis=1)
    numbers, cells = _number_cells(voxels.points, settings.CELL * voxel)
    order = np.argsort(numbers, kind="stable")
    numbers_of_points = numbers[voxels.indices]
    points = in_double(thinned.points)[np.argsort(numbers_of_points, kind="stable")]
    ends = [np.bincount(each, minlength=len(cells)).cumsum() for each in (numbers, numbers_of_points)]
    of_voxels = made.points[order], made.normals[order], frames[order], descriptors[order]
    return Level(voxel, points, *of_voxels, cells, *ends)


def _number_cells(points: FloatArray, size: float) -> tuple[IndexArray, FloatArray]:
    """Return the cell number of each point, and the centres of the cells."""
    places = np.floor(points / size)
    least = places.min(axis=0)
    shape = tuple((places.max(axis=0) - least + 1).astype(np.int64).tolist())
    numbers = np.ravel_multi_index(tuple((places - least).astype(np.int64).T), shape)
    cells, numbers = np.unique(numbers, return_inverse=True)
    return numbers, (np.stack(np.unravel_index(cells, shape), axis=1) + least + 0.5) * size


def _batches(ends: IndexArray, size: int) -> Iterator[tuple[int, int]]:
    """Split rows into runs of complete cells of about a given size; return first and end cell of each."""
    first = 0
    while first < len(ends):
        done = ends[first - 1] if first else 0
        last = max(int(np.searchsorted(ends, done + size, side="right")), first + 1)
        yield first, last
        first = last


def _rows_of(cells: IndexArray, ends: IndexArray) -> IndexArray:
    """Return the rows of some cells, cell by cell."""
    starts = np.concatenate([[0], ends])
    return np.concatenate([np.arange(int(starts[cell]), int(ends[cell])) for cell in cells])
