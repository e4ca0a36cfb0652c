"""GTM, game theory matching."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from cgroup.methods.types import OtsuMode, Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def gtm(
    source: AnyCloud,
    target: AnyCloud,
    *,
    iterations: int = 100,
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
    one_to_one: bool = False,
    payoff: Literal["distance_ratio", "distance_difference"] = "distance_ratio",
    resolution: float | None = None,
    tolerance: float | None = None,
    convergence_tolerance: float | None = None,
    dynamics: Literal["replicator", "infection_immunisation"] = "replicator",
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Game theory matching (GTM): correspondences that agree with survivors survive.

    Section 3.2, Eq. (17) and (18) of [1]_, after [2]_. Cost O(n^2) per step. Payoffs of more than 1,024
    correspondences are rounded to 16 bits, by 8e-6 at most.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    iterations : int
        Steps of the dynamics; more of them select fewer correspondences.
    threshold : float or "otsu"
        Population shares above it are selected.
    otsu : {"minmax", "exact", "covis", "legacy"}
        How Otsu's cut is sought: on 100 equal bins between least and greatest score, between any two
        scores, as in the code of SI's author (for scores in [0,1]), or as in the evaluation group's later
        code.
    one_to_one : bool
        Pairs that share a point earn nothing; the distance ratio implies it.
    payoff : {"distance_ratio", "distance_difference"}
        ``min(ds/dt, dt/ds)``; or 1 where ``|ds - dt|`` is at most `tolerance`, else 0.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds, for the second payoff.
    tolerance : float, optional
        Greatest ``|ds - dt|`` of the second payoff, a length; default ``3 * resolution``.
    convergence_tolerance : float, optional
        Stop once a step moves the population by less (L1 norm); infection-immunisation stops at this
        Nash error, 1e-8 by default.
    dynamics : {"replicator", "infection_immunisation"}
        Replicator dynamics, Eq. (17); or infection and immunisation (Rota Bulo, Bomze, 2011) at O(n)
        per step, whose survivors (share above 1e-9) are selected. Give it some 10,000 iterations.
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
        Its scores are the population shares, which sum to 1, and `Grouping.threshold` is the cut on them.

    Raises
    ------
    InputError
        If points aren't (n,3), finite and as many on both sides; for an option out of its range; for the
        payoff "distance_difference" where neither `tolerance` nor `resolution` is given.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    References
    ----------
    .. [1] J. Yang, K. Xian, P. Wang, Y. Zhang, "A Performance Evaluation of Correspondence Grouping Methods
       for 3D Rigid Data Matching", IEEE TPAMI, 2019.
    .. [2] E. Rodola, A. Albarelli, F. Bergamasco, A. Torsello, "A Scale Independent Selection Process for 3D
       Object Recognition in Cluttered Scenes", IJCV, 2013.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import gtm
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 500, inlier_ratio=0.3)
    >>> group = gtm(problem.source, problem.target)
    >>> precision = problem.inlier_mask[group.mask].mean()
    >>> bool(precision > 0.9)  # of all matches 30 % are right
    True
    >>> longer = gtm(problem.source, problem.target, iterations=500)
    >>> longer.size < group.size
    True
    """
    return call("gtm", locals())
