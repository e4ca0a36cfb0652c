"""GC, geometric consistency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def gc(
    source: AnyCloud,
    target: AnyCloud,
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
    """Geometric consistency (GC): the largest cluster that keeps distances to a seed.

    Section 3.2, Eq. (13) of [1]_, after [2]_. Cost O(n^2) time, O(n) memory; the clique variant keeps all
    consistent pairs, one bit each, where these n^2 / 8 bytes are allowed. Of equally large clusters that of
    the first row is taken: with the rows in another order the group may be another one.

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
    iterations : int
        Clique variant: samples of the RANSAC filter.
    seed : int
        Clique variant: key of the filter's random numbers.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Clique variant: bytes that the consistent pairs may take; by default a quarter of the memory that is
        free, at most 1.5 GiB. Beyond it pairs are computed anew, with the same result.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1]; an error that it raises ends the work.

    Returns
    -------
    Grouping
        Its scores are the sizes of the star clusters (star variant).

    Raises
    ------
    InputError
        If points aren't (n,3), finite and as many on both sides; for an option out of its range; where
        neither `tolerance` nor `resolution` is given.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    References
    ----------
    .. [1] J. Yang, K. Xian, P. Wang, Y. Zhang, "A Performance Evaluation of Correspondence Grouping Methods
       for 3D Rigid Data Matching", IEEE TPAMI, 2019.
    .. [2] H. Chen, B. Bhanu, "3D Free-Form Object Recognition in Range Images Using Local Surface Patches",
       Pattern Recognition Letters, 2007.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import gc
    >>> rng = np.random.default_rng(0)
    >>> source = rng.uniform(0, 100, size=(500, 3))
    >>> target = source[:, [1, 2, 0]] + 5.0
    >>> target[100:] = rng.uniform(0, 100, size=(400, 3))
    >>> group = gc(source, target, resolution=1.0)
    >>> bool(group.mask[:100].all()), int(group.scores.max()) == group.size
    (True, True)
    """
    return call("gc", locals())
