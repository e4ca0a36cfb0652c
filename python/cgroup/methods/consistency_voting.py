"""CV, consistency voting."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from cgroup._calls import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import OtsuMode, Progress
    from cgroup.types import Grouping


def cv(
    source: ArrayLike,
    target: ArrayLike,
    *,
    ratio: ArrayLike,
    source_lrf: ArrayLike,
    target_lrf: ArrayLike,
    resolution: float | None = None,
    distance_scale: float | None = None,
    angle_scale: float = 10.0,
    voters: int = 200,
    exclude_self: bool = False,
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
    threads: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Consistency voting (CV): distinctive correspondences vote by distance and frame consistency.

    The paper, section 3.1, after Yang, Xiao, Cao, PRL 2019. Cost O(n voters).

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    ratio : (n,) array_like of float
        Nearest / second-nearest descriptor distance.
    source_lrf, target_lrf : (n,3,3) array_like of float
        Local reference frames; rows are the x, y and z axes; NaN for no frame.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds.
    distance_scale : float, optional
        Distance difference at which a vote falls to 1/e, a length; default ``10 * resolution``.
    angle_scale : float
        Difference of frame angles at which a vote falls to 1/e, in degrees.
    voters : int
        Number of voters: the correspondences with the lowest ratios.
    exclude_self : bool
        Leave out the vote of a voter for itself.
    threshold : float or "otsu"
        Scores above it are selected.
    otsu : {"minmax", "exact", "covis", "legacy"}
        How Otsu's cut is sought, see `ss`.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1].

    Returns
    -------
    Grouping
        Its scores are sums of votes, in [0, voters].

    Raises
    ------
    InputError
        For fields or options that the method can't work with.
    """
    return call("cv", locals())
