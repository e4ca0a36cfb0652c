"""Surface normals: plane fits, or averages over a mesh's faces."""

from __future__ import annotations

from typing import TypeAlias

from numpy.typing import ArrayLike

from cgroup import _core
from cgroup._checks.arrays import as_faces, as_place
from cgroup._checks.calls import explain_wrong_calls
from cgroup._checks.values import as_count, as_number, run_options
from cgroup.features.cloud import CloudLike, core_cloud, places_of
from cgroup.types import FloatArray

Viewpoint: TypeAlias = tuple[float, float, float]
"""Where a scanner stood, in its cloud's frame."""

ORIGIN: Viewpoint = (0.0, 0.0, 0.0)


@explain_wrong_calls
def normals(
    points: CloudLike,
    *,
    neighbors: int | None = None,
    radius: float | None = None,
    viewpoint: ArrayLike = ORIGIN,
    threads: int | None = None,
) -> FloatArray:
    """Fit a plane to the neighbourhood of every point (as PCL's ``NormalEstimation``).

    Points that coincide count once. SHOT and LFSH depend on the side the normals point to. A viewpoint is
    right for a scan taken from it; for whole models use `mesh_normals`, or move the viewpoint along with the
    model. Cost O(N log N), then O(N neighbors). `points` and `threads` are as for `shot`.

    Parameters
    ----------
    neighbors : int, optional
        Distinct points per plane, the point itself included; 20 by default.
    radius : float, optional
        Use all points nearer than this instead; if both are given, only the nearest `neighbors` of them (as
        Open3D's hybrid search).
    viewpoint : (3,) array_like of float
        Normals point to this side.

    Returns
    -------
    (N,3) array of float64
        Unit vectors; NaN rows where fewer than three points, or points on one line, leave the plane open.

    Examples
    --------
    >>> from cgroup import features
    >>> grid = [[x, y, 0] for x in range(5) for y in range(5)]
    >>> upwards = features.normals(grid, neighbors=9, viewpoint=(0, 0, 1))[:, 2]
    >>> bool((upwards > 0.999).all())
    True
    """
    place = as_place("viewpoint", viewpoint)
    count = None if neighbors is None else as_count("neighbors", neighbors, 1)
    size = None if radius is None else as_number("radius", radius)
    places = places_of(points)
    return places.spread(_core.normals(places.core, run_options(threads), count, size, place))


@explain_wrong_calls
def mesh_normals(points: CloudLike, faces: ArrayLike) -> FloatArray:
    """Return consistently oriented vertex normals of a mesh, weighted by area.

    Faces are oriented consistently within every connected part: outwards if it is closed, else as most of its
    area is wound. Cost O(F log F). `points` are as for `shot`.

    Parameters
    ----------
    faces : (F,3) array_like of int
        Rows of `points`.

    Returns
    -------
    (N,3) array of float64
        Unit vectors; NaN rows for points without a face.
    """
    return _core.mesh_normals(core_cloud(points), as_faces("faces", faces), run_options(1))
