"""SI, search of inliers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._calls import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import OtsuMode, Progress
    from cgroup.types import Grouping


def si(
    source: ArrayLike,
    target: ArrayLike,
    *,
    ratio: ArrayLike,
    source_lrf: ArrayLike,
    target_lrf: ArrayLike,
    resolution: float | None = None,
    tolerance: float | None = None,
    neighbors: int = 250,
    min_distance_ratio: float = 0.9,
    lowe_ratio: float = 0.8,
    global_rank: Literal["lowe", "local_score"] = "lowe",
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
    threads: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Search of inliers (SI): voting by neighbours, then by the most distinctive correspondences.

    The paper, section 3.1, after Buch, Yang, Kruger, Petersen, CVPR 2014. Cost O(n log n + n neighbors).

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    ratio : (n,) array_like of float
        Nearest / second-nearest descriptor distance.
    source_lrf, target_lrf : (n,3,3) array_like of float
        Local reference frames; rows are the x, y and z axes; NaN for no frame.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds.
    tolerance : float, optional
        Greatest residual under the pose of a correspondence, a length; default ``5 * resolution``.
    neighbors : int
        Number of local neighbours, and of global voters (kappa).
    min_distance_ratio : float
        Least rigidity ``min(ds/dt, dt/ds)`` of a vote (sigma).
    lowe_ratio : float
        Local voters have a lower ratio.
    global_rank : {"lowe", "local_score"}
        Global voters are those with the lowest ratio, or those with the best local score as in the
        original author's code.
    threshold : float or "otsu"
        Scores above it are selected.
    otsu : {"minmax", "exact", "covis", "legacy"}
        How Otsu's cut is sought, see `ss`.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1].

    Returns
    -------
    Grouping
        Its scores are shares of votes, in [0,1].

    Raises
    ------
    InputError
        For fields or options that the method can't work with.
    """
    return call("si", locals())
