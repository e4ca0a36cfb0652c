"""SS, similarity score."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import OtsuMode
    from cgroup.types import Grouping


@explain_wrong_calls
def ss(
    similarity: ArrayLike,
    *,
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
    bins: int = 100,
    threads: int | None = None,
) -> Grouping:
    """Similarity score (SS): keep correspondences whose descriptors are similar.

    Section 3.1, Eq. (1) of [1]_. Cost O(n).

    Parameters
    ----------
    similarity : (n,) array_like of float
        Descriptor similarity ``1 - |f_norm - f'_norm|``, higher is better; -inf is never selected.
    threshold : float or "otsu"
        Least similarity that is accepted.
    otsu : {"minmax", "exact", "covis", "legacy"}
        How Otsu's cut is sought: on equal bins between least and greatest score, between any two
        scores, as in the code of SI's author (for scores in [0,1]), or as in the evaluation group's
        later code.
    bins : int
        Bins of the "minmax" and "legacy" modes.
    threads : int, optional
        For the sake of one style; this method takes microseconds and one thread.

    Returns
    -------
    Grouping
        Its scores are the similarities, `Grouping.threshold` the cut. Without points, so that
        `Grouping.transform` needs `cgroup.group`.

    Raises
    ------
    InputError
        If the similarities aren't (n,) numbers, or one is NaN; for an option out of its range.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    References
    ----------
    .. [1] J. Yang, K. Xian, P. Wang, Y. Zhang, "A Performance Evaluation of Correspondence Grouping Methods
       for 3D Rigid Data Matching", IEEE TPAMI, 2019.

    Examples
    --------
    >>> from cgroup import ss
    >>> group = ss([0.95, 0.2, 0.9, 0.25, 0.88])
    >>> group.mask
    array([ True, False,  True, False,  True])
    >>> ss([0.95, 0.2, 0.9, 0.25, 0.88], threshold=0.9).indices
    array([0, 2])
    """
    return call("ss", locals())
