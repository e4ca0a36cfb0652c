"""MAC, maximal cliques."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from cgroup.methods.types import Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def mac(
    source: AnyCloud,
    target: AnyCloud,
    *,
    resolution: float | None = None,
    tolerance: float | None = None,
    max_distance_difference: float | None = None,
    min_weight: float = 0.99,
    min_clique_size: int = 3,
    max_cliques: int = 1_000_000,
    max_hypotheses: int | None = None,
    refine: bool = True,
    max_seconds: float | None = None,
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Maximal cliques (MAC): the best motion that cliques of agreeing matches propose.

    Zhang et al., *3D Registration with Maximal Cliques*, CVPR 2023, section 3; Yang et al., TPAMI 2024. Two
    correspondences with the distance difference ``d = |ds - dt|`` agree with the weight ``w = 1 - (1 -
    min_weight) (d / max_distance_difference)^2`` where d is not greater than that, else 0 (Eq. 1, 2: the
    source's ``1 - d^2 / d_cmp^2``, cut at `min_weight`). The second order ``W = w o (w w)`` (Eq. 3) weighs
    a pair by those that agree with both. A dense graph is reduced to the vertices with the greatest
    clustering coefficients ``c_i = sum_(j<k) (W_ij W_ik W_jk)^(1/3) / (deg_i (deg_i - 1) / 2)``. All
    maximal cliques are sought; each vertex keeps the one with the greatest sum of W over its pairs, and
    each clique that was kept proposes its least-squares motion. The best has the greatest sum of ``1 - r /
    tolerance`` over the residuals ``r < tolerance``.

    Cost O(n^2) tests of pairs, a step for each path of two edges, and the cliques. Memory 14 bytes for each
    of the two directions of a pair that agrees.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds.
    tolerance : float, optional
        Residuals below this length belong to the group; default ``5 * resolution``.
    max_distance_difference : float, optional
        Greatest distance difference of two that agree, a length; default ``tolerance / 5``.
    min_weight : float
        Weight of two that differ by `max_distance_difference`, in [0,1).
    min_clique_size : int
        Least members of a clique, 3 or more.
    max_cliques : int
        Most ends of the search: maximal cliques, and dead ends. Every vertex from which it starts gets an
        equal share, one at least, of what those before it left.
    max_hypotheses : int, optional
        Take only so many cliques, the heaviest; by default all.
    refine : bool
        Refine the best motion by weighted least squares over the group, up to 20 times.
    max_seconds : float, optional
        End the search for cliques after this time, with the cliques found by then. Only where that happens,
        the result depends on the machine and on the number of threads.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Bytes that the graph of agreeing pairs may take; by default a quarter of the memory that is free, at
        most 1.5 GiB.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1]; an error that it raises ends the work.

    Returns
    -------
    Grouping
        The correspondences with a residual below `tolerance` under `Grouping.model`. The score of a
        correspondence is the weight of the heaviest clique that it is in, 0 where it is in none. Without a
        clique that fixes a motion, the group is empty. Diagnostics: ``vertices`` of the graph,
        ``reduced_vertices`` among which cliques were sought, ``cliques`` found, ``hypotheses`` judged; and
        ``truncated`` where the search ended at `max_cliques` or `max_seconds`,
        or where the graph has only the vertices of the highest degrees, because all would exceed
        `max_memory` or 2^30 paths.

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
    >>> from cgroup import mac
    >>> rng = np.random.default_rng(0)
    >>> source = rng.uniform(0, 100, size=(500, 3))
    >>> target = source[:, [1, 2, 0]] + 5.0
    >>> target[25:] = rng.uniform(0, 100, size=(475, 3))
    >>> result = mac(source, target, resolution=1.0)
    >>> bool(result.mask[:25].all()), result.model[:3, 3].round(1)
    (True, array([5., 5., 5.]))
    """
    return call("mac", locals())
