"""TEASER++, truncated least squares estimation and semidefinite relaxation."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from cgroup.methods.types import Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def teaser(
    source: AnyCloud,
    target: AnyCloud,
    *,
    resolution: float | None = None,
    tolerance: float | None = None,
    max_distance_difference: float | None = None,
    prune: Literal["clique", "core"] = "clique",
    dof: Literal[6, 4] = 6,
    scale: Literal["known", "estimate"] = "known",
    max_steps: int = 1_000_000,
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """TEASER++: truncated least squares, after pruning those that disagree in pairs.

    Yang, Shi, Carlone, *TEASER: Fast and certifiable point cloud registration*, T-RO 2021,
    with the pruning by core numbers of ROBIN (ICRA 2021) and KISS-Matcher (ICRA 2025). Two correspondences
    are joined where ``|ds - dt| < max_distance_difference`` and ``0 < ds + dt`` (section IV). The
    rotation is that of graduated non-convexity on the differences of each kept point to the next (section
    VII), the translation that of adaptive voting along each axis (section V). Costs and ranges are in units
    of the tolerance, so that an outlier costs 1 in the voting, as in the paper; the published code has the
    tolerance itself there, and its voting depends on the unit of length. Each point's next one, and which of
    several maximum cliques is found, depend on the order of the rows, and so may the group. Cost O(n^2) tests
    of pairs, memory n^2 / 8 bytes.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds.
    tolerance : float, optional
        beta, bound on the error of a right correspondence, a length; default ``2.5 * resolution``.
    max_distance_difference : float, optional
        Bound on ``|ds - dt|`` of two that are joined, a length; default ``2 * tolerance``.
    prune : {"clique", "core"}
        What is kept: a maximum clique (TEASER++), or all that are in the core of the greatest core number
        (KISS-Matcher), which takes less time where the noise is large, and more of the wrong ones.
    dof : {6, 4}
        4 for a rotation about the z axis (Quatro, ICRA 2022): give clouds whose z axes point against gravity.
    scale : {"known", "estimate"}
        Estimate a common factor of all lengths first, from ``dt / ds`` of all pairs. Of more than some 1,400
        correspondences a million pairs are taken.
    max_steps : int
        Bound on the search for a maximum clique: vertices that may be coloured.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Bytes that the graph of agreeing pairs may take; by default a quarter of the memory that is free, at
        most 1.5 GiB. A larger graph is refused.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1]; an error that it raises ends the work.

    Returns
    -------
    Grouping
        Those kept by the pruning whose residual under `Grouping.model` is at most `tolerance` along each
        axis of the target; without three kept that fix a rotation, none. With an estimated scale s the
        model is a similarity, ``s R`` in its upper left; s is in `diagnostics` under ``scale``, and
        `Grouping.transform` stays a rigid motion, which does not know of it. `diagnostics` has ``kept``,
        how many were left by the pruning, and ``steps``. Where the search for a clique ran out of steps, or
        not all pairs told of the scale, ``truncated`` is 1: the clique is the largest found.

    Raises
    ------
    InputError
        If points aren't (n,3), finite and as many on both sides; for an option out of its range; where
        neither `tolerance` nor `resolution` is given; where the graph exceeds `max_memory`.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import teaser
    >>> rng = np.random.default_rng(0)
    >>> source = rng.uniform(0, 100, size=(500, 3))
    >>> target = source[:, [1, 2, 0]] + 5.0
    >>> target[100:] = rng.uniform(0, 100, size=(400, 3))
    >>> result = teaser(source, target, tolerance=0.1)
    >>> bool(result.mask[:100].all()), result.model[:3, 3].round(1)
    (True, array([5., 5., 5.]))
    """
    return call("teaser", locals())
