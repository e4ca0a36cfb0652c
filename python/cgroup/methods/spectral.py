"""ST, the spectral technique."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def st(
    source: AnyCloud,
    target: AnyCloud,
    *,
    min_distance_ratio: float = 0.6,
    affinity: Literal["raw", "threshold", "binary"] = "raw",
    diagonal: Literal["zero", "one", "score"] = "zero",
    similarity: ArrayLike | None = None,
    conflict: Literal["rigidity", "one_to_one", "both"] = "rigidity",
    eigensolver: Literal["power", "dense"] = "power",
    recompute: bool = False,
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Spectral technique (ST): the main cluster of the pairwise affinity matrix.

    Section 3.2, Eq. (12) of [1]_, after [2]_: correspondences are accepted in the order of their entries in
    the principal eigenvector, each unless it conflicts with one accepted before. Cost O(n^2) per power step.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    min_distance_ratio : float
        Correspondences with a lower ``min(ds/dt, dt/ds)`` conflict with each other.
    affinity : {"raw", "threshold", "binary"}
        That ratio; the ratio where it reaches `min_distance_ratio`, else 0; or 1 there.
    diagonal : {"zero", "one", "score"}
        Affinity of a correspondence with itself; "score" is `similarity`.
    similarity : (n,) array_like of float, optional
        Descriptor similarity, for ``diagonal="score"``.
    conflict : {"rigidity", "one_to_one", "both"}
        An accepted correspondence removes those below `min_distance_ratio`, those that share a point
        with it, or both.
    eigensolver : {"power", "dense"}
        Power iteration, or Lanczos's method on a matrix of float64, to the last digits (at most ``16 n^2``
        bytes): the reference, some tens of products with the matrix.
    recompute : bool
        Compute the eigenvector of what is left after each acceptance.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Bytes that the pairwise matrix may take; by default a quarter of the memory that is free, at most
        1.5 GiB. A larger matrix is recomputed row by row, with the same result.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1]; an error that it raises ends the work.

    Returns
    -------
    Grouping
        Its scores are the entries of the principal eigenvector.

    Raises
    ------
    InputError
        If points aren't (n,3), finite and as many on both sides; for an option out of its range; for
        ``diagonal="score"`` without `similarity`, or with one above 1e300; where the matrix of
        ``eigensolver="dense"`` exceeds `max_memory`.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    References
    ----------
    .. [1] J. Yang, K. Xian, P. Wang, Y. Zhang, "A Performance Evaluation of Correspondence Grouping Methods
       for 3D Rigid Data Matching", IEEE TPAMI, 2019.
    .. [2] M. Leordeanu, M. Hebert, "A Spectral Technique for Correspondence Problems Using Pairwise
       Constraints", ICCV, 2005.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import st
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 500, inlier_ratio=0.3)
    >>> group = st(problem.source, problem.target)
    >>> precision = problem.inlier_mask[group.mask].mean()
    >>> bool(precision > 0.8)  # of all matches 30 % are right
    True
    """
    return call("st", locals())
