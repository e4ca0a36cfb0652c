"""NNSR, nearest-neighbour similarity ratio."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup._calls import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.types import Grouping


def nnsr(ratio: ArrayLike, *, max_ratio: float = 0.8, threads: int | None = None) -> Grouping:
    """Nearest-neighbour similarity ratio (NNSR): keep the distinctive correspondences.

    The paper, section 3.1, after Lowe, IJCV 2004. The printed bound 0.8 on ``1 - d1/d2`` is Lowe's bound
    on ``d1/d2``; ``max_ratio=0.2`` is the formula read to the letter. Cost O(n).

    Parameters
    ----------
    ratio : (n,) array_like of float
        Nearest / second-nearest descriptor distance, in [0,1], lower is better.
    max_ratio : float
        Greatest ratio that is accepted.
    threads : int, optional
        For the sake of one style; this method takes microseconds and one thread.

    Returns
    -------
    Grouping
        Its scores are ``1 - ratio``.

    Raises
    ------
    InputError
        For fields or options that the method can't work with.
    """
    return call("nnsr", locals())
