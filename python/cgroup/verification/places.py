"""Classify the points of a surface under a pose."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cgroup import _core
from cgroup._checks.run_options import run_options
from cgroup.rigid import check_rigid
from cgroup.verification.surface import Surface, core_surfaces


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

    As in the last round of `verify`: with the nearest point y, normal m, of the target (up to 4 units away),
    a moved point x lies on it where ``((x - y).m)^2 + 0.15 |x - y|^2 < t^2``, t = 2 units, and the normals'
    cosine exceeds 0.8. Without a near point, the target's observed ranges decide, with a tolerance of 3
    units. If the scanner is known, points that face away from it (cosine 0.3) or that lie 3 units behind the
    source's own surface are unknown.

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
    >>> surface = Surface(
    ...     points, features.normals(points), unit=0.4 * pr, viewpoint=(0, 0, 0)
    ... )
    >>> found = places(surface, surface, np.eye(4))
    >>> sorted({Place(place).name for place in found})
    ['ON', 'UNKNOWN']
    """
    return _core.places(*core_surfaces(source, target), check_rigid(pose, "pose")[None], run_options(threads))
