"""A cloud indexed once, and its resolution."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeAlias

from cgroup import _core
from cgroup._checks.arrays import real_points
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_flag, as_word, run_options
from cgroup.errors import InputError
from cgroup.features._places import Places, find_distinct, renumber
from cgroup.types import AnyCloud, RealArray


class Cloud:
    """A point cloud, checked and indexed once for all functions of `cgroup.features`.

    Each of them takes an array too, but then checks, centres and indexes it again. A `Cloud` keeps its
    search tree, the neighbours within the last three radii, and its resolution: up to 240 bytes per point.
    Results are the same bits. Threads may share a cloud.

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
    >>> pr = features.resolution(cloud)
    >>> keypoints = features.harris3d(cloud, resolution=pr, threshold=1e-6)
    >>> descriptors = features.shot(
    ...     cloud, features.normals(cloud), keypoints, radius=15 * pr
    ... )
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
        """Pickle the points; they are indexed anew."""
        return partial(Cloud, name=self._name), (self._points,)

    @property
    def points(self) -> RealArray:
        """The points as given, read-only: (N,3) array of float32 or float64."""
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
    """Return what the compiled core takes: that of the cloud, or one of the array alone."""
    if isinstance(points, Cloud):
        return points._core  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - not for users
    return _core.Cloud(real_points(name, points), name)


def places_of(points: CloudLike, name: str = "points") -> Places:
    """Return one point for each place of a cloud, for the compiled core; a `Cloud` keeps them."""
    if not isinstance(points, Cloud):
        return _find_places(real_points(name, points), core_cloud(points, name), name)
    known = points._places  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - not for users
    if known is None:
        known = _find_places(points.points, core_cloud(points), name)
        points._places = known  # noqa: SLF001 # pyright: ignore[reportPrivateUsage]
    return known


def _find_places(points: RealArray, core: _core.Cloud, name: str) -> Places:
    first = find_distinct(points)
    if first is None:
        return Places(core)
    return Places(_core.Cloud(points[first], name), first, renumber(points, first))


@explain_wrong_calls
def resolution(points: CloudLike, *, ignore_zero: bool = False, threads: int | None = None) -> float:
    """Return the mean distance of a point to its nearest other point, the unit *pr*.

    Points that coincide count once.

    `threads` is as for `shot`.

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
    """Return the resolution of the distinct points of a cloud, which keeps it."""
    if places.rows is not None and len(places.core) < 2:
        got = f"{len(places.rows)} points that all coincide"
        raise InputError("points", got, "a resolution needs two distinct points")
    return _core.resolution(places.core, run_options(threads), ignore_zero=False)
