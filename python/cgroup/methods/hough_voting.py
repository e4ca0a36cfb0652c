"""3DHV, 3D Hough voting."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def hough3d(
    source: AnyCloud,
    target: AnyCloud,
    *,
    source_lrf: ArrayLike,
    target_lrf: ArrayLike,
    source_centroid: ArrayLike | None = None,
    bins: int = 15,
    bin_size: float | None = None,
    neighbors: Literal[0, 6, 26] = 6,
    variant: Literal["grid", "pcl"] = "grid",
    interpolation: bool = True,
    distance_weight: bool = False,
    similarity: ArrayLike | None = None,
    vote_threshold: float = -1.0,
    iterations: int = 10_000,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """3D Hough voting (3DHV): votes for where the source's centroid is in the target.

    Section 3.2, Eq. (14) to (16) of [1]_, after [2]_. Cost O(n log n).

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    source_lrf, target_lrf : (n,3,3) array_like of float
        Local reference frames; rows are the x, y and z axes; NaN for no frame, which casts no vote.
    source_centroid : (3,) array_like of float, optional
        Centroid of the whole source cloud; the mean of `source` where it is not given (`diagnostics`
        say so under ``centroid_from_keypoints``).
    bins : int
        Bins per axis over the votes' bounding box.
    bin_size : float, optional
        Side of cubic bins, a length, in place of `bins`; the "pcl" variant needs it.
    neighbors : {0, 6, 26}
        Bins around the peak whose voters are selected with it.
    variant : {"grid", "pcl"}
        "grid", as in [1]_: one vote each, for the bin that it falls in. "pcl", as in PCL: votes are
        interpolated, and each local maximum is filtered by RANSAC.
    interpolation : bool
        "pcl" variant: spread a vote over the up to 8 bins whose centres surround it.
    distance_weight : bool
        "pcl" variant: weigh a vote by ``1 - d / d_max``, with d = ``1 - similarity``.
    similarity : (n,) array_like of float, optional
        Descriptor similarity, for `distance_weight`.
    vote_threshold : float
        "pcl" variant: least value of a maximum; from -1 to 0, a share of the greatest value.
    iterations : int
        "pcl" variant: samples of the RANSAC filter.
    seed : int
        "pcl" variant: key of the filter's random numbers.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1]; an error that it raises ends the work.

    Returns
    -------
    Grouping
        The voters of the fullest bin and its neighbours; without scores.

    Raises
    ------
    InputError
        If points aren't (n,3), finite and as many on both sides, or a frame is neither a rotation nor NaN;
        for an option out of its range; for the "pcl" variant without `bin_size`; for `distance_weight`
        without `similarity`.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    References
    ----------
    .. [1] J. Yang, K. Xian, P. Wang, Y. Zhang, "A Performance Evaluation of Correspondence Grouping Methods
       for 3D Rigid Data Matching", IEEE TPAMI, 2019.
    .. [2] F. Tombari, L. Di Stefano, "Object Recognition in 3D Scenes with Occlusions and Clutter by Hough
       Voting", PSIVT, 2010.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import hough3d
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 500, inlier_ratio=0.3)
    >>> frames = {"source_lrf": problem.source_lrf, "target_lrf": problem.target_lrf}
    >>> group = hough3d(problem.source, problem.target, **frames)
    >>> precision = problem.inlier_mask[group.mask].mean()
    >>> bool(precision > 0.9)  # of all matches 30 % are right
    True
    """
    return call("3dhv", locals())
