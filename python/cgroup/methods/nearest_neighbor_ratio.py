"""NNSR, nearest-neighbour similarity ratio."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.types import Grouping


@explain_wrong_calls
def nnsr(ratio: ArrayLike, *, max_ratio: float = 0.8, threads: int | None = None) -> Grouping:
    """Nearest-neighbour similarity ratio (NNSR): keep the distinctive correspondences.

    Section 3.1, Eq. (2) of [1]_, after [2]_. The printed bound 0.8 on ``1 - d1/d2`` is Lowe's bound on
    ``d1/d2``; ``max_ratio=0.2`` is the formula read to the letter. Cost O(n).

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
        Its scores are ``1 - ratio``. Without points, so that `Grouping.transform` needs `cgroup.group`.

    Raises
    ------
    InputError
        If the ratios aren't (n,) numbers in [0,1], or `max_ratio` is no number in [0,1].
    OutOfMemoryError
        Where the system gives no memory for the computation.

    References
    ----------
    .. [1] J. Yang, K. Xian, P. Wang, Y. Zhang, "A Performance Evaluation of Correspondence Grouping Methods
       for 3D Rigid Data Matching", IEEE TPAMI, 2019.
    .. [2] D. Lowe, "Distinctive Image Features from Scale-Invariant Keypoints", IJCV, 2004.

    Examples
    --------
    >>> from cgroup import nnsr
    >>> nnsr([0.3, 0.95, 0.7]).mask
    array([ True, False,  True])
    >>> nnsr([0.3, 0.95, 0.7], max_ratio=0.5).mask
    array([ True, False, False])
    """
    return call("nnsr", locals())
