"""Surfaces for verifying poses, and the position of points on them."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup import _core
from cgroup._checks.arrays import as_place, real_normals, real_points
from cgroup._checks.values import as_flag, as_instance, as_number, run_options
from cgroup.errors import InputError
from cgroup.rigid import check_rigid
from cgroup.types import AnyCloud


class Surface:
    """A surface for verifying poses, prepared once for all poses and partners.

    It keeps nearest points, ranges and samples. Memory grows with the points and their surface, some
    kilobytes per point, not with the bounding box. Threads may share a surface. `threads` is as for `shot`.

    Parameters
    ----------
    points : (N,3) array_like of float
        Ten or more, finite, about evenly spread: downsample a raw scan to voxels first.
    normals : (N,3) array_like of float
        Of any length; NaN or zero for none.
    unit : float
        0.4 of the voxel or of the distance between points. All tolerances are multiples of it. Both surfaces
        of a pair need the same.
    viewpoint : (3,) array_like of float, optional
        Position of the scanner, for a single scan with normals towards it. Points in front of the observed
        surface then count against a pose. Leave it out for points fused from several scans.
    oriented : bool, optional
        Whether the normals point to the same side of the surface in both clouds; otherwise a normal and its
        opposite are equal. By default true if there is a viewpoint.

    Examples
    --------
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.verification import Surface
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> Surface(points, features.normals(points), unit=0.4 * pr, viewpoint=(0, 0, 0))
    Surface(n=2554)
    """

    __slots__ = ("_core", "_unit")

    def __init__(
        self,
        points: AnyCloud,
        normals: ArrayLike,
        *,
        unit: float,
        viewpoint: ArrayLike | None = None,
        oriented: bool | None = None,
        threads: int | None = None,
    ) -> None:
        rows, directions = real_points("points", points), real_normals("normals", normals)
        if len(rows) != len(directions):
            got = f"{len(directions)} for {len(rows)} points"
            raise InputError("normals", got, "give one per point, NaN for none")
        self._unit = as_number("unit", unit)
        eye = None if viewpoint is None else as_place("viewpoint", viewpoint)
        known = eye is not None if oriented is None else as_flag("oriented", oriented)
        self._core = _core.Surface(rows, directions, run_options(threads), self._unit, eye, known)

    @classmethod
    def of_core(cls, core: _core.Surface, unit: float) -> Surface:
        """Wrap a surface of the compiled core.

        :meta private:
        """
        made = cls.__new__(cls)
        made._core, made._unit = core, unit  # noqa: SLF001 - its own
        return made

    @property
    def unit(self) -> float:
        """The unit of all tolerances, in the unit of the points."""
        return self._unit

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self._core)

    def __repr__(self) -> str:
        return f"Surface(n={len(self)})"


def core_surfaces(source: Surface, target: Surface) -> tuple[_core.Surface, _core.Surface]:
    """Check two surfaces; return those of the compiled core."""
    pair = as_instance("source", source, Surface), as_instance("target", target, Surface)
    return pair[0]._core, pair[1]._core  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] - not for users


class Place(IntEnum):
    """Position of a moved point of one surface with respect to the other surface.

    Attributes
    ----------
    UNKNOWN : 0
        Hidden from the other's scanner by either surface, without a normal, or away from a surface whose
        scanner is unknown.
    ON : 1
        On the other surface, which faces the same way.
    OFF : 2
        Near the other surface, but not on it, or facing another way.
    IN_FRONT : 3
        In the free space in front of the surface that the other's scanner observed.
    BACKGROUND : 4
        In front of a background that the other's scanner observed as empty.
    """

    UNKNOWN = 0
    ON = 1
    OFF = 2
    IN_FRONT = 3
    BACKGROUND = 4


def places(
    source: Surface, target: Surface, pose: ArrayLike, *, threads: int | None = None
) -> NDArray[np.uint8]:
    """Classify each source point under a pose by its position on the target.

    As in the last round of `verify`. Without a near point, the target's observed ranges decide. If the
    scanner is known, points that face away from it, or that lie behind the source's own surface, are unknown.
    `pose` is as for `align`; the other parameters are as for `verify`.

    Returns
    -------
    (n,) array of uint8
        A `Place` per point of the source, in their order.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.verification import Place, Surface, places
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> unit, planes = 0.4 * pr, features.normals(points)
    >>> surface = Surface(points, planes, unit=unit, viewpoint=(0, 0, 0))
    >>> found = places(surface, surface, np.eye(4))
    >>> sorted({Place(place).name for place in found})
    ['ON', 'UNKNOWN']
    """
    return _core.places(*core_surfaces(source, target), check_rigid(pose, "pose")[None], run_options(threads))
