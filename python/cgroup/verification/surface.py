"""Surfaces for verifying poses."""

from __future__ import annotations

from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.arrays import as_place, real_normals, real_points
from cgroup._checks.run_options import run_options
from cgroup._checks.values import as_flag, as_instance, as_number
from cgroup.errors import InputError
from cgroup.types import AnyCloud


class Surface:
    """A surface for verifying poses, prepared once for all poses and partners.

    It keeps nearest points, ranges and samples. Memory grows with the points and their surface, some
    kilobytes per point, not with the bounding box. Threads may share a surface.

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
    threads : int, optional
        Number of threads; all cores by default. The result does not depend on it.

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
            raise InputError(
                "normals",
                f"{len(directions)} for {len(rows)} points",
                "give one per point, NaN for none",
            )
        self._unit = as_number("unit", unit)
        eye = None if viewpoint is None else as_place("viewpoint", viewpoint)
        known = eye is not None if oriented is None else as_flag("oriented", oriented)
        self._core = _core.Surface(rows, directions, run_options(threads), self._unit, eye, known)

    @property
    def unit(self) -> float:
        """The length that all tolerances are multiples of, in the unit of the points."""
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
