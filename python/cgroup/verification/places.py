"""Nearest places on a surface under a pose."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup import _core
from cgroup._checks.run_options import run_options
from cgroup.verification._poses import as_pose
from cgroup.verification.surface import Surface, core_surfaces


class Place(IntEnum):
    """Where a moved point of one surface lies with respect to the other.

    Attributes
    ----------
    UNKNOWN : 0
        Hidden from the other's scanner, by either surface; or without a normal; or away from a surface whose
        scanner is not known.
    ON : 1
        On the other surface, which faces the same way.
    OFF : 2
        Near the other surface, but not on it, or facing another way.
    IN_FRONT : 3
        In front of what the other's scanner saw: had the point been there, it would have been seen.
    BACKGROUND : 4
        Where the other's scanner saw nothing, and should have seen the point.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup.verification import Place
    >>> found = np.array([1, 1, 0, 3], dtype=np.uint8)  # as `places` returns them
    >>> int((found == Place.ON).sum()), Place(found[3]).name
    (2, 'IN_FRONT')
    """

    UNKNOWN = 0
    ON = 1
    OFF = 2
    IN_FRONT = 3
    BACKGROUND = 4


def places(
    source: Surface, target: Surface, pose: ArrayLike, *, threads: int | None = None
) -> NDArray[np.uint8]:
    """Say where each point of the source comes to lie under a pose.

    By the measure of the last round of `verify`: with the nearest point y, normal m, of the target (up to 4
    units away), a moved point x lies on it where ``((x - y).m)^2 + 0.15 |x - y|^2 < t^2``, t = 2 units, and
    the normals' cosine exceeds 0.8. Where none is near, what the target's scanner saw decides, with a
    tolerance of 3 units. If the scanner is known, points that face away from it (cosine 0.3) or that lie 3
    units behind the source's own surface are left out as unknown.

    Parameters
    ----------
    source, target : Surface
        Of the same unit.
    pose : (4,4) array_like of float
        Rigid transform from the source into the target.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.

    Returns
    -------
    (n,) array of uint8
        A `Place` per point of the source, in their order.

    Raises
    ------
    InputError
        For a pose that is not rigid, surfaces of different units, or what is no `Surface`.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import features
    >>> from cgroup.datasets import standin_pair
    >>> from cgroup.verification import Place, Surface, places
    >>> points = standin_pair(pixels=60).source.points
    >>> pr = features.resolution(points)
    >>> surface = Surface(
    ...     points, features.normals(points), unit=0.4 * pr, viewpoint=(0, 0, 0)
    ... )
    >>> found = places(surface, surface, np.eye(4))
    >>> sorted({Place(place).name for place in found})
    ['ON', 'UNKNOWN']
    """
    return _core.places(*core_surfaces(source, target), as_pose(pose), run_options(threads))
