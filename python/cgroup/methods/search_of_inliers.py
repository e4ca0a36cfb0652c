"""SI, search of inliers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import OtsuMode, Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def si(
    source: AnyCloud,
    target: AnyCloud,
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
    """Search of inliers (SI): votes of neighbours, then of the most distinctive.

    Section 3.1, Eq. (3) to (6) of [1]_, after [2]_. Cost O(n log n + n neighbors).

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
        How Otsu's cut is sought: on 100 equal bins between least and greatest score, between any two
        scores, as in the code of SI's author (for scores in [0,1]), or as in the evaluation group's later
        code.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1]; an error that it raises ends the work.

    Returns
    -------
    Grouping
        Its scores are shares of votes, in [0,1], and `Grouping.threshold` is the cut on them.

    Raises
    ------
    InputError
        If points aren't (n,3), finite and as many on both sides, or a ratio or a frame isn't what it should
        be; for an option out of its range; where neither `tolerance` nor `resolution` is given.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    References
    ----------
    .. [1] J. Yang, K. Xian, P. Wang, Y. Zhang, "A Performance Evaluation of Correspondence Grouping Methods
       for 3D Rigid Data Matching", IEEE TPAMI, 2019.
    .. [2] A. G. Buch, Y. Yang, N. Kruger, H. G. Petersen, "In Search of Inliers: 3D Correspondence by Local
       and Global Voting", CVPR, 2014.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import si
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 500, inlier_ratio=0.3)
    >>> fields = ("source", "target", "ratio", "source_lrf", "target_lrf", "resolution")
    >>> group = si(**{name: getattr(problem, name) for name in fields})
    >>> precision = problem.inlier_mask[group.mask].mean()
    >>> bool(precision > 0.9)  # of all matches 30 % are right
    True
    """
    return call("si", locals())
