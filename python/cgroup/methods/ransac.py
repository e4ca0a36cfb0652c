"""RANSAC, random sample consensus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from cgroup.methods.types import Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def ransac(
    source: AnyCloud,
    target: AnyCloud,
    *,
    resolution: float | None = None,
    tolerance: float | None = None,
    iterations: int = 10_000,
    seed: int = 0,
    refine: bool = False,
    edge_ratio: float | None = None,
    confidence: float | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Random sample consensus (RANSAC): the sampled motion that most agree with.

    Section 3.2 of [1]_, after [2]_: a sample is three correspondences, its motion their least-squares
    transform. Cost O(iterations n). Samples are rows: with the rows in another order they are others, as with
    another `seed`.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds.
    tolerance : float, optional
        An inlier's residual is less than this length; default ``5 * resolution``.
    iterations : int
        Number of samples.
    seed : int
        Key of the random numbers, which depend on it and on the iteration alone.
    refine : bool
        Fit the transform to all inliers once and select again.
    edge_ratio : float, optional
        Drop samples with an edge whose length ratio ``min(ds/dt, dt/ds)`` is lower, before judging them.
    confidence : float, optional
        Stop once a better transform has been missed with probability at most ``1 - confidence``.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1]; an error that it raises ends the work.

    Returns
    -------
    Grouping
        Its `model` is the transform (4,4) behind the selection. Without any inlier the group is empty.

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
    .. [2] M. Fischler, R. Bolles, "Random Sample Consensus: A Paradigm for Model Fitting with Applications to
       Image Analysis and Automated Cartography", CACM, 1981.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import ransac
    >>> rng = np.random.default_rng(0)
    >>> source = rng.uniform(0, 100, size=(500, 3))
    >>> target = source[:, [1, 2, 0]] + 5.0
    >>> target[100:] = rng.uniform(0, 100, size=(400, 3))
    >>> group = ransac(source, target, resolution=1.0, refine=True)
    >>> bool(group.mask[:100].all()), group.model[:3, 3].round(0)
    (True, array([5., 5., 5.]))
    """
    return call("ransac", locals())
