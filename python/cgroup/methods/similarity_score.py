"""SS, similarity score."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._calls import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import OtsuMode
    from cgroup.types import Grouping


def ss(
    similarity: ArrayLike,
    *,
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
    bins: int = 100,
    threads: int | None = None,
) -> Grouping:
    """Similarity score (SS): keep the correspondences whose descriptors are similar enough.

    The paper, section 3.1. Cost O(n).

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
        Its scores are the similarities.

    Raises
    ------
    InputError
        For fields or options that the method can't work with.
    """
    return call("ss", locals())
