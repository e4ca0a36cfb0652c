"""GTM, game theory matching."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._calls import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import OtsuMode, Progress
    from cgroup.types import Grouping


def gtm(
    source: ArrayLike,
    target: ArrayLike,
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
    """Game theory matching (GTM): correspondences that agree with many survivors survive.

    The paper, section 3.2, after Rodola, Albarelli, Bergamasco, Torsello, IJCV 2013. Cost O(n^2) per step.
    Payoffs of more than 1,024 correspondences are rounded to 16 bits, by 8e-6 at most.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    iterations : int
        Steps of the dynamics; more of them select fewer correspondences.
    threshold : float or "otsu"
        Population shares above it are selected.
    otsu : {"minmax", "exact", "covis", "legacy"}
        How Otsu's cut is sought, see `ss`.
    one_to_one : bool
        Pairs that share a point earn nothing; the distance ratio implies it.
    payoff : {"distance_ratio", "distance_difference"}
        ``min(ds/dt, dt/ds)``; or 1 where ``|ds - dt|`` is at most `tolerance`, else 0.
    resolution, tolerance : float, optional
        Lengths for the second payoff; the default tolerance is ``3 * resolution``.
    convergence_tolerance : float, optional
        Stop once a step moves the population by less (L1 norm); infection-immunisation stops at this
        Nash error, 1e-8 by default.
    dynamics : {"replicator", "infection_immunisation"}
        The paper's replicator dynamics; or infection and immunisation (Rota Bulo, Bomze, 2011) at O(n)
        per step, whose survivors (share above 1e-9) are selected. Give it some 10,000 iterations.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Bytes that the pairwise matrix may take; by default a quarter of the memory that is free, at most
        1.5 GiB. A larger matrix is recomputed row by row, with the same result.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1].

    Returns
    -------
    Grouping
        Its scores are the population shares, which sum to 1.

    Raises
    ------
    InputError
        For fields or options that the method can't work with.
    """
    return call("gtm", locals())
