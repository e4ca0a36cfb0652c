"""RANSAC, random sample consensus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup._calls import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import Progress
    from cgroup.types import Grouping


def ransac(
    source: ArrayLike,
    target: ArrayLike,
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
    """Random sample consensus (RANSAC): the transform of three correspondences that most agree with.

    The paper, section 3.2, after Fischler, Bolles, CACM 1981. Cost O(iterations n).

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
        Called now and then with the share of the work done, in [0,1].

    Returns
    -------
    Grouping
        Its `model` is the transform (4,4) behind the selection. Without any inlier the group is empty.

    Raises
    ------
    InputError
        For fields or options that the method can't work with.
    """
    return call("ransac", locals())
