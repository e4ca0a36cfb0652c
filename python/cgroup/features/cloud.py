"""A cloud indexed once, its distinct points and resolution, and points near another cloud."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from cgroup import _core
from cgroup._checks.arrays import finite_points, real_points
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_flag, as_length, as_word, run_options
from cgroup.errors import InputError
from cgroup.types import AnyCloud, BoolArray, IndexArray, RealArray

Value = TypeVar("Value", bound=np.generic)


@dataclass(frozen=True, eq=False)
class Places:
    """Distinct points of a cloud, and their mapping to the input points."""

    core: _core.Cloud  # of the first point of each place, in the order of the cloud
    # (M,), row of each of them in the cloud; None where no two points coincide
    first: IndexArray | None = None
    rows: IndexArray | None = None  # (N,), place of each point of the cloud; None where no two coincide

    def keypoints(self, rows: IndexArray) -> IndexArray:
        """Return the distinct points of rows of the cloud."""
        if self.rows is None:  # the core checks them
            return rows
        wrong = np.flatnonzero(rows >= len(self.rows))
        if len(wrong):
            got = f"index {rows[wrong[0]]} in row {wrong[0]}"
            raise InputError("keypoints", got, f"the cloud has {len(self.rows)} points")
        return self.rows[rows]

    def normals(self, given: RealArray) -> RealArray:
        """Return the normal of each distinct point: the first normal of its coincident points."""
        if self.first is None or self.rows is None:  # the core checks their number
            return given
        if len(given) != len(self.rows):
            raise InputError("normals", f"{len(given)} rows", f"give {len(self.rows)}, one per point")
        chosen = self.first.copy()
        known = np.flatnonzero(np.isfinite(given).all(axis=1))[::-1]
        chosen[self.rows[known]] = known
        return given[chosen]

    def spread(self, values: NDArray[Value]) -> NDArray[Value]:
        """Return the value of each point of the cloud from those of the distinct points."""
        return values if self.rows is None else values[self.rows]

    def first_rows(self, places: IndexArray) -> IndexArray:
        """Return the first row of each of these distinct points, ascending if they are."""
        return places if self.first is None else self.first[places]


class Cloud:
    """A point cloud, checked and indexed once for all functions of `cgroup.features`.

    Each of them takes an array too, but then checks, centres and indexes it again. A `Cloud` keeps its search
    tree, the neighbours within the last three radii, its own axes, and its resolution: up to 264 bytes per
    point. Results are identical to the bit. Threads may share a cloud.

    Parameters
    ----------
    points : (N,3) array_like of float
        Finite. Arrays of float32 and float64 are not copied; don't change them while the cloud is in use.
    name : str
        Name of the points in error messages.

    Attributes
    ----------
    points : (N,3) array of float32 or float64
        As given, read-only.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> cloud = features.Cloud(standin_pair(pixels=60).source.points)
    >>> keypoints, planes = features.harris3d(cloud, count=50), features.normals(cloud)
    >>> descriptors = features.shot(cloud, planes, keypoints, radius=20)
    """

    __slots__ = ("_core", "_name", "_places", "_points")

    def __init__(self, points: AnyCloud, *, name: str = "points") -> None:
        array = real_points(as_word("name", name), points).view()
        array.flags.writeable = False
        self._points: RealArray = array
        self._name = name
        self._core = _core.Cloud(array, name)
        self._places: Places | None = None

    def __reduce__(self) -> tuple[Callable[[RealArray], Cloud], tuple[RealArray]]:
        """Pickle the points; the index is built again."""
        return partial(Cloud, name=self._name), (self._points,)

    @property
    def points(self) -> RealArray:
        """The input points, read-only: (N,3) array of float32 or float64."""
        return self._points

    @property
    def diagonal(self) -> float:
        """Diagonal of the bounding box, in the unit of the points."""
        return self._core.diagonal

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self._points)

    def __repr__(self) -> str:
        return f"Cloud(n={len(self)})"


CloudLike: TypeAlias = "Cloud | AnyCloud"


def core_cloud(points: CloudLike, name: str = "points") -> _core.Cloud:
    """Return the compiled core's cloud: that of the cloud, or a new one of an array."""
    if isinstance(points, Cloud):
        return points._core  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - not for users
    return _core.Cloud(real_points(name, points), name)


def places_of(points: CloudLike, name: str = "points") -> Places:
    """Return the distinct points of a cloud for the compiled core; a `Cloud` stores them."""
    if not isinstance(points, Cloud):
        return _find_places(real_points(name, points), core_cloud(points, name), name)
    known = points._places  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - not for users
    if known is None:
        known = _find_places(points.points, core_cloud(points), name)
        points._places = known  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
    return known


def _find_places(points: RealArray, core: _core.Cloud, name: str) -> Places:
    found = _core.distinct_points(points)
    return Places(core) if found is None else Places(_core.Cloud(points[found[0]], name), *found)


@explain_wrong_calls
def resolution(points: CloudLike, *, ignore_zero: bool = False, threads: int | None = None) -> float:
    """Return the mean distance of a point to its nearest other point, the unit *pr*.

    Points that coincide count once. `threads` is as for `shot`.

    Parameters
    ----------
    points : Cloud or (N,3) array_like of float
        Two distinct points or more.
    ignore_zero : bool
        Leave out points that have a duplicate, rather than count them once.

    Returns
    -------
    float
        A length in the unit of the points.

    Examples
    --------
    >>> from cgroup import features
    >>> features.resolution([[0, 0, 0], [1, 0, 0], [3, 0, 0]])
    1.3333333333333333
    """
    options = run_options(threads)
    if as_flag("ignore_zero", ignore_zero):
        return _core.resolution(core_cloud(points), options, ignore_zero=True)
    return resolution_of(places_of(points), threads)


def resolution_of(places: Places, threads: int | None) -> float:
    """Return the resolution of the distinct points of a cloud, which stores it."""
    if places.rows is not None and len(places.core) < 2:
        got = f"{len(places.rows)} points that all coincide"
        raise InputError("points", got, "a resolution needs two distinct points")
    return _core.resolution(places.core, run_options(threads), ignore_zero=False)


@explain_wrong_calls
def within(points: AnyCloud, others: AnyCloud, radius: float) -> BoolArray:
    """Return the mask of points with at least one of the others within a radius.

    Parameters
    ----------
    points : (N,3) array_like of float
        Points to judge.
    others : (M,3) array_like of float
        Points to search.
    radius : float
        Largest distance, inclusive, in the data's unit.

    Returns
    -------
    (N,) array of bool
        Aligned with `points`.

    Examples
    --------
    >>> from cgroup.features import within
    >>> within([[0, 0, 0], [5, 0, 0]], [[0, 0, 1]], radius=1.0)
    array([ True, False])
    """
    queries, stored = finite_points("points", points), finite_points("others", others)
    return _core.within(queries, stored, run_options(), as_length("radius", radius))
