"""CLIPPER, the densest set of correspondences that all agree."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from cgroup.methods.types import Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def clipper(
    source: AnyCloud,
    target: AnyCloud,
    *,
    resolution: float | None = None,
    max_distance_difference: float | None = None,
    deviation: float | None = None,
    min_distance: float = 0.0,
    variant: Literal["densest", "maximum"] = "densest",
    seed: int = 0,
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """CLIPPER: the densest set of correspondences that all agree with each other.

    Lusk, Fathian, How, ICRA 2021 (Algorithm 1), with the certificate of CLIPPER+ (Fathian,
    Summers, RA-L 2024). Affinities ``M_ij = exp(-(ds - dt)^2 / (2 deviation^2))`` of pairs with ``|ds - dt| <
    max_distance_difference`` that share no point; two others exclude each other. Projected gradient ascent
    makes ``u' M u`` greatest for ``u >= 0``, ``|u| = 1``, with a penalty on excluded pairs that grows until
    none is left. The group are the ``round(u' M u)`` correspondences of the greatest u. Rounding, which
    depends on the order of the rows, may decide in which of nearly equal sets the ascent ends. Cost O(n^2)
    tests of pairs and O(pairs that agree) per step; memory n^2 / 8 bytes, and 4 per agreeing ordered pair
    where that fits.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds.
    max_distance_difference : float, optional
        epsilon, bound on ``|ds - dt|`` of two that agree, a length; default ``5 * resolution``.
    deviation : float, optional
        sigma, the standard deviation of ``ds - dt``, a length; default ``max_distance_difference / 3``.
    min_distance : float
        Two that are no farther apart than this length on either side exclude each other.
    variant : {"densest", "maximum"}
        Seek the set with the greatest sum of affinities per member (CLIPPER), or the one with the most
        members (CLIPPER+: all affinities are 1, and a greedy clique comes first).
    seed : int
        Key of the random numbers that the ascent starts from; a number depends on it and on its row alone.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Bytes that graph and affinities may take; by default a quarter of the memory that is free, at most
        1.5 GiB. A larger graph is refused; affinities that don't fit are computed anew in each step.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1]; an error that it raises ends the work.

    Returns
    -------
    Grouping
        The selected set, and its least-squares motion as `Grouping.model`; fewer than three, or a set on one
        line, are no group. The scores are u. `diagnostics`: ``objective`` is ``u' M u``, ``rounds`` the
        number of penalties, and ``certified`` 1 where the set is proved to be a clique that no other exceeds
        in size: it has as many members as the greatest core number plus one, or as a colouring has colours.
        Where 1,000 rounds, or a penalty of 1e9, were not enough, ``truncated`` is 1.

    Raises
    ------
    InputError
        If points aren't (n,3), finite and as many on both sides; for an option out of its range; where
        neither `max_distance_difference` nor `resolution` is given; where the graph exceeds `max_memory`.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import clipper
    >>> rng = np.random.default_rng(0)
    >>> source = rng.uniform(0, 100, size=(500, 3))
    >>> target = source[:, [1, 2, 0]] + 5.0
    >>> target[100:] = rng.uniform(0, 100, size=(400, 3))
    >>> result = clipper(source, target, max_distance_difference=0.01)
    >>> bool(result.mask[:100].all()), result.diagnostics["certified"]
    (True, 1.0)
    """
    return call("clipper", locals())
