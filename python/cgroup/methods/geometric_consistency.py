"""GC, geometric consistency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._calls import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import Progress
    from cgroup.types import Grouping


def gc(
    source: ArrayLike,
    target: ArrayLike,
    *,
    resolution: float | None = None,
    tolerance: float | None = None,
    variant: Literal["star", "clique"] = "star",
    ties: Literal["lowest", "union"] = "lowest",
    similarity: ArrayLike | None = None,
    min_cluster_size: int = 3,
    iterations: int = 10_000,
    seed: int = 0,
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Geometric consistency (GC): the largest cluster that keeps its distances to a seed.

    The paper, section 3.2, after Chen, Bhanu, PRL 2007. Cost O(n^2) time, O(n) memory; the
    clique variant keeps all consistent pairs, one bit each, where these n^2 / 8 bytes are allowed.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds.
    tolerance : float, optional
        Two correspondences are consistent where ``|ds - dt|`` is less than this length; default
        ``3 * resolution``.
    variant : {"star", "clique"}
        A seed and all that are consistent with it; or, as in PCL, a set grown greedily in the order of
        `similarity` whose members are all consistent with each other, filtered by RANSAC.
    ties : {"lowest", "union"}
        Of several largest stars, take that of the lowest index, or all.
    similarity : (n,) array_like of float, optional
        Descriptor similarity, for the visiting order of the clique variant.
    min_cluster_size : int
        Clique variant: a set with no more members is no cluster.
    iterations, seed : int
        Clique variant: of the RANSAC filter.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Clique variant: bytes that the consistent pairs may take; by default a quarter of the memory that is
        free, at most 1.5 GiB. Beyond it pairs are computed anew, with the same result.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1].

    Returns
    -------
    Grouping
        Its scores are the sizes of the star clusters (star variant).

    Raises
    ------
    InputError
        For fields or options that the method can't work with.
    """
    return call("gc", locals())
