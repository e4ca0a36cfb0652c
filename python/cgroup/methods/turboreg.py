"""TurboReg, triangles around heavy pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from cgroup.methods.types import Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def turboreg(
    source: AnyCloud,
    target: AnyCloud,
    *,
    resolution: float | None = None,
    tolerance: float | None = None,
    max_distance_difference: float | None = None,
    nms_radius: float | None = None,
    pivots: int = 2_000,
    cliques_per_pivot: int = 2,
    choice: Literal["inliers", "mae", "mse"] = "inliers",
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """TurboReg: poses of triangles around the pairs that agree with the same others.

    Yan, Shi, Zhao, Wang, Cao, Wu, Li, "TurboReg: TurboClique for Robust and Efficient Point
    Cloud Registration", ICCV 2025, section 3. Two correspondences are compatible where ``|ds - dt|`` is below
    `max_distance_difference`, a bound far below the tolerance, and ``ds + dt`` exceeds `nms_radius`; such a
    pair weighs as much as others are compatible with both. The heaviest pairs are pivots, and each gives the
    triangles of greatest weight. The pose of a triangle that is the best by `choice` is refined. Ties go to
    the lowest row: with the rows in another order the group may be another one. Cost O(n^2) tests of pairs,
    and O(n^3 / 64) for the share of pairs that are compatible.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds.
    tolerance : float, optional
        An inlier's residual is less than this length; default ``5 * resolution``. Published: 0.1 m in rooms
        thinned to 5 cm (preset ``3dmatch``); for streets nothing but 0.6 m is (preset ``kitti``).
    max_distance_difference : float, optional
        Bound on ``|ds - dt|`` of two that are compatible, a length; default ``0.12 * tolerance``.
    nms_radius : float, optional
        ``ds + dt`` of two that are compatible exceeds this length; default ``1.5 * tolerance``.
    pivots : int
        Number of pairs that triangles are sought for, the heaviest (K1).
    cliques_per_pivot : int
        Triangles of each (K2).
    choice : {"inliers", "mae", "mse"}
        What the best pose has most of, with r a residual below the tolerance t: their number, the sum of
        ``1 - r / t``, or the sum of ``(1 - r / t)^2``.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Bytes that the graph of compatible pairs may take (it takes n^2 / 8); by default a quarter of the
        memory that is free, at most 1.5 GiB. Where it is larger, only the correspondences that are compatible
        with the most others, as many as fit, give triangles: `Grouping.complete` is False then, and
        ``diagnostics["vertices"]`` says how many.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1]; an error that it raises ends the work.

    Returns
    -------
    Grouping
        The inliers of `Grouping.model`, the refined pose. Without any triangle the group is empty.

    Raises
    ------
    InputError
        If points aren't (n,3), finite and as many on both sides; for an option out of its range; where
        neither `tolerance` nor `resolution` is given.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import turboreg
    >>> rng = np.random.default_rng(0)
    >>> source = rng.uniform(0, 100, size=(500, 3))
    >>> target = source[:, [1, 2, 0]] + 5.0
    >>> target[25:] = rng.uniform(0, 100, size=(475, 3))
    >>> result = turboreg(source, target, resolution=1.0)
    >>> bool(result.mask[:25].all()), result.model[:3, 3].round(1)
    (True, array([5., 5., 5.]))
    """
    return call("turboreg", locals())
