"""CV, consistency voting."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import OtsuMode, Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def cv(
    source: AnyCloud,
    target: AnyCloud,
    *,
    ratio: ArrayLike,
    source_lrf: ArrayLike,
    target_lrf: ArrayLike,
    resolution: float | None = None,
    distance_scale: float | None = None,
    angle_scale: float = 10.0,
    voters: int = 200,
    exclude_self: bool = False,
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
    threads: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Consistency voting (CV): votes of the most distinctive correspondences.

    Section 3.1, Eq. (7) to (11) of [1]_, after [2]_. A vote falls with the difference of the distances, and
    with that of the angles between the frames. Cost O(n voters).

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
    distance_scale : float, optional
        Distance difference at which a vote falls to 1/e, a length; default ``10 * resolution``.
    angle_scale : float
        Difference of frame angles at which a vote falls to 1/e, in degrees.
    voters : int
        Number of voters: the correspondences with the lowest ratios.
    exclude_self : bool
        Leave out the vote of a voter for itself.
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
        Its scores are sums of votes, in [0, voters], and `Grouping.threshold` is the cut on them.

    Raises
    ------
    InputError
        If points aren't (n,3), finite and as many on both sides, or a ratio or a frame isn't what it should
        be; for an option out of its range; where neither `distance_scale` nor `resolution` is given.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    References
    ----------
    .. [1] J. Yang, K. Xian, P. Wang, Y. Zhang, "A Performance Evaluation of Correspondence Grouping Methods
       for 3D Rigid Data Matching", IEEE TPAMI, 2019.
    .. [2] J. Yang, Y. Xiao, Z. Cao, "Ranking 3D Feature Correspondences via Consistency Voting", Pattern
       Recognition Letters, 2019.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import cv
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 500, inlier_ratio=0.3)
    >>> fields = ("source", "target", "ratio", "source_lrf", "target_lrf", "resolution")
    >>> group = cv(**{name: getattr(problem, name) for name in fields})
    >>> precision = problem.inlier_mask[group.mask].mean()
    >>> bool(precision > 0.9)  # of all matches 30 % are right
    True
    """
    return call("cv", locals())
