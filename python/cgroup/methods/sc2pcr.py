"""SC2-PCR, second-order spatial compatibility."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cgroup._checks.calls import explain_wrong_calls
from cgroup.methods._call import call

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cgroup.methods.types import Progress
    from cgroup.types import AnyCloud, Grouping


@explain_wrong_calls
def sc2pcr(
    source: AnyCloud,
    target: AnyCloud,
    *,
    candidates: ArrayLike | None = None,
    resolution: float | None = None,
    tolerance: float | None = None,
    max_distance_difference: float | None = None,
    seed_ratio: float = 0.2,
    nms_radius: float | None = None,
    k1: int = 30,
    k2: int = 20,
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """SC2-PCR: correspondences that agree with the same others follow the same motion.

    Chen, Sun, Yang, Tao, "SC2-PCR: A Second Order Spatial Compatibility for Efficient and
    Robust Point Cloud Registration", CVPR 2022, section 3. Two correspondences are compatible where
    ``|ds - dt|`` is below `max_distance_difference`, and how many others are compatible (at half that bound)
    with both is their second-order compatibility. Seeds are the correspondences with the highest confidence,
    their entry in the principal eigenvector of the compatibility. Around each gathers a consensus set in two
    stages; the weighted least-squares pose of a set with the most inliers is refined. Ties go to the lowest
    row: with the rows in another order the group may be another one. Cost O(n^2) per power step,
    and O(n^3 / 64) for the share of pairs that are compatible.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    candidates : (n,k,3) array_like of float, optional
        Target points that each source point may match, the likeliest first, such as those of its 100 nearest
        descriptors (`cgroup.features.match`, k=100). With them the pose is chosen as in SC2-PCR++ (Chen et
        al., TPAMI 2023): each of the 50 poses with the most inliers is refined by one round. Source points
        that it lays within `tolerance` of a candidate take the first one within ``1.5 * tolerance``, and the
        pose scores the most of them that are compatible, at half the bound, with one of them. The published
        `k1` and `k2` are 20 and 10 then.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds.
    tolerance : float, optional
        An inlier's residual is less than this length; default ``5 * resolution``. Published: 0.1 m in rooms
        thinned to 5 cm, 0.6 m on streets thinned to 30 cm (presets ``3dmatch`` and ``kitti``).
    max_distance_difference : float, optional
        Bound on ``|ds - dt|`` of two that are compatible, a length; default `tolerance`.
    seed_ratio : float
        Share of the correspondences that are seeds, in [0,1]; one is at least.
    nms_radius : float, optional
        Seeds are first the most confident within this length in the source, then the others by confidence;
        default `tolerance`.
    k1 : int
        Members of a consensus set after its first stage.
    k2 : int
        Members of a consensus set after its second stage.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Bytes that pairwise matrices may take; by default a quarter of the memory that is free, at most
        1.5 GiB. A compatibility matrix (n^2 bytes) that is larger is recomputed for each power step. Where
        the graph of compatible pairs (n^2 / 8 bytes) is larger, only the most confident correspondences whose
        graph fits give seeds and sets: `Grouping.complete` is False then, and ``diagnostics["vertices"]``
        says how many.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1]; an error that it raises ends the work.

    Returns
    -------
    Grouping
        The inliers of `Grouping.model`, the refined pose. Its scores are the confidences. Where no set fixes
        a pose the group is empty.

    Raises
    ------
    InputError
        If points aren't (n,3), finite and as many on both sides, or candidates aren't (n,k,3); for an option
        out of its range; where neither `tolerance` nor `resolution` is given.
    OutOfMemoryError
        Where the system gives no memory for the computation.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import sc2pcr
    >>> rng = np.random.default_rng(0)
    >>> source = rng.uniform(0, 100, size=(500, 3))
    >>> target = source[:, [1, 2, 0]] + 5.0
    >>> target[50:] = rng.uniform(0, 100, size=(450, 3))
    >>> result = sc2pcr(source, target, resolution=1.0)
    >>> bool(result.mask[:50].all()), result.model[:3, 3].round(1)
    (True, array([5., 5., 5.]))
    """
    return call("sc2pcr", locals())
