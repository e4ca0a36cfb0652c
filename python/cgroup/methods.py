"""The grouping methods: typed signatures and what they mean.

References are to J. Yang, K. Xian, P. Wang, Y. Zhang, *A Performance Evaluation of Correspondence
Grouping Methods for 3D Rigid Data Matching*, TPAMI 2019 ("the paper").

A length (``tolerance`` and the like) is in the data's unit; without one it is the paper's multiple of
``resolution``. Each function hands its arguments on by their names; the compiled core reads its options.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from cgroup._calls import call

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike

    from cgroup.types import Grouping

    Progress: TypeAlias = Callable[[float], Any]

__all__ = ["cv", "gc", "gtm", "hough3d", "lc", "nnsr", "ransac", "si", "ss", "st"]

OtsuMode: TypeAlias = Literal["minmax", "exact", "covis", "legacy"]


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


def si(
    source: ArrayLike,
    target: ArrayLike,
    *,
    ratio: ArrayLike,
    source_lrf: ArrayLike,
    target_lrf: ArrayLike,
    resolution: float | None = None,
    tolerance: float | None = None,
    neighbors: int = 250,
    min_distance_ratio: float = 0.9,
    lowe_ratio: float = 0.8,
    global_rank: Literal["lowe", "local_score"] = "lowe",
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
    threads: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Search of inliers (SI): voting by neighbours, then by the most distinctive correspondences.

    The paper, section 3.1, after Buch, Yang, Kruger, Petersen, CVPR 2014. Cost O(n log n + n neighbors).

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
    tolerance : float, optional
        Greatest residual under the pose of a correspondence, a length; default ``5 * resolution``.
    neighbors : int
        Number of local neighbours, and of global voters (kappa).
    min_distance_ratio : float
        Least rigidity ``min(ds/dt, dt/ds)`` of a vote (sigma).
    lowe_ratio : float
        Local voters have a lower ratio.
    global_rank : {"lowe", "local_score"}
        Global voters are those with the lowest ratio, or those with the best local score as in the
        original author's code.
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
        Its scores are shares of votes, in [0,1].

    Raises
    ------
    InputError
        For fields or options that the method can't work with.
    """
    return call("si", locals())


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


def st(
    source: ArrayLike,
    target: ArrayLike,
    *,
    min_distance_ratio: float = 0.6,
    affinity: Literal["raw", "threshold", "binary"] = "raw",
    diagonal: Literal["zero", "one", "score"] = "zero",
    similarity: ArrayLike | None = None,
    conflict: Literal["rigidity", "one_to_one", "both"] = "rigidity",
    eigensolver: Literal["power", "dense"] = "power",
    recompute: bool = False,
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Spectral technique (ST): the main cluster of the pairwise affinity matrix.

    The paper, section 3.2, after Leordeanu, Hebert, ICCV 2005. Cost O(n^2) per power step.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    min_distance_ratio : float
        Correspondences with a lower ``min(ds/dt, dt/ds)`` conflict with each other.
    affinity : {"raw", "threshold", "binary"}
        That ratio; the ratio where it reaches `min_distance_ratio`, else 0; or 1 there.
    diagonal : {"zero", "one", "score"}
        Affinity of a correspondence with itself; "score" is `similarity`.
    similarity : (n,) array_like of float, optional
        Descriptor similarity, for ``diagonal="score"``.
    conflict : {"rigidity", "one_to_one", "both"}
        An accepted correspondence removes those below `min_distance_ratio`, those that share a point
        with it, or both.
    eigensolver : {"power", "dense"}
        Power iteration, or a full O(n^3) decomposition (about ``40 n^2`` bytes).
    recompute : bool
        Compute the eigenvector of what is left after each acceptance.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Bytes that the pairwise matrix may take; by default a quarter of the memory that is free, at most
        1.5 GiB. A larger matrix is recomputed row by row, with the same result.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1].

    Returns
    -------
    Grouping
        Its scores are the entries of the principal eigenvector.

    Raises
    ------
    InputError
        For fields or options that the method can't work with.
    """
    return call("st", locals())


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
    progress: Progress | None = None,
) -> Grouping:
    """Geometric consistency (GC): the largest cluster that keeps its distances to a seed.

    The paper, section 3.2, after Chen, Bhanu, PRL 2007. Cost O(n^2) time, O(n) memory.

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


def hough3d(
    source: ArrayLike,
    target: ArrayLike,
    *,
    source_lrf: ArrayLike,
    target_lrf: ArrayLike,
    source_centroid: ArrayLike | None = None,
    bins: int = 15,
    bin_size: float | None = None,
    neighbors: Literal[0, 6, 26] = 6,
    variant: Literal["grid", "pcl"] = "grid",
    interpolation: bool = True,
    distance_weight: bool = False,
    similarity: ArrayLike | None = None,
    vote_threshold: float = -1.0,
    iterations: int = 10_000,
    seed: int = 0,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """3D Hough voting (3DHV): correspondences vote for the source's centroid in the target.

    The paper, section 3.2, after Tombari, Di Stefano, PSIVT 2010. Cost O(n log n).

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    source_lrf, target_lrf : (n,3,3) array_like of float
        Local reference frames; rows are the x, y and z axes; NaN for no frame, which casts no vote.
    source_centroid : (3,) array_like of float, optional
        Centroid of the whole source cloud; the mean of `source` where it is not given (the diagnostics
        say so under ``centroid_from_keypoints``).
    bins : int
        Bins per axis over the votes' bounding box.
    bin_size : float, optional
        Side of cubic bins, a length, in place of `bins`; the "pcl" variant needs it.
    neighbors : {0, 6, 26}
        Bins around the peak whose voters are selected with it.
    variant : {"grid", "pcl"}
        The paper's; or PCL's, where votes are interpolated, and each local maximum is filtered by RANSAC.
    interpolation : bool
        "pcl" variant: spread a vote over the up to 8 bins whose centres surround it.
    distance_weight : bool
        "pcl" variant: weigh a vote by ``1 - d / d_max``, with d = ``1 - similarity``.
    similarity : (n,) array_like of float, optional
        Descriptor similarity, for `distance_weight`.
    vote_threshold : float
        "pcl" variant: least value of a maximum; from -1 to 0, a share of the greatest value.
    iterations, seed : int
        "pcl" variant: of the RANSAC filter.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1].

    Returns
    -------
    Grouping
        Without scores.

    Raises
    ------
    InputError
        For fields or options that the method can't work with.
    """
    return call("3dhv", locals())


def gtm(
    source: ArrayLike,
    target: ArrayLike,
    *,
    iterations: int = 100,
    threshold: float | Literal["otsu"] = "otsu",
    otsu: OtsuMode = "minmax",
    one_to_one: bool = False,
    payoff: Literal["distance_ratio", "distance_difference"] = "distance_ratio",
    resolution: float | None = None,
    tolerance: float | None = None,
    convergence_tolerance: float | None = None,
    dynamics: Literal["replicator", "infection_immunisation"] = "replicator",
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Game theory matching (GTM): correspondences that agree with many survivors survive.

    The paper, section 3.2, after Rodola, Albarelli, Bergamasco, Torsello, IJCV 2013. Cost O(n^2) per step.
    Payoffs of more than 1,024 correspondences are rounded to 16 bits, by 8e-6 at most.

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    iterations : int
        Steps of the dynamics; more of them select fewer correspondences.
    threshold : float or "otsu"
        Population shares above it are selected.
    otsu : {"minmax", "exact", "covis", "legacy"}
        How Otsu's cut is sought, see `ss`.
    one_to_one : bool
        Pairs that share a point earn nothing; the distance ratio implies it.
    payoff : {"distance_ratio", "distance_difference"}
        ``min(ds/dt, dt/ds)``; or 1 where ``|ds - dt|`` is at most `tolerance`, else 0.
    resolution, tolerance : float, optional
        Lengths for the second payoff; the default tolerance is ``3 * resolution``.
    convergence_tolerance : float, optional
        Stop once a step moves the population by less (L1 norm); infection-immunisation stops at this
        Nash error, 1e-8 by default.
    dynamics : {"replicator", "infection_immunisation"}
        The paper's replicator dynamics; or infection and immunisation (Rota Bulo, Bomze, 2011) at O(n)
        per step, whose survivors (share above 1e-9) are selected. Give it some 10,000 iterations.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Bytes that the pairwise matrix may take; by default a quarter of the memory that is free, at most
        1.5 GiB. A larger matrix is recomputed row by row, with the same result.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1].

    Returns
    -------
    Grouping
        Its scores are the population shares, which sum to 1.

    Raises
    ------
    InputError
        For fields or options that the method can't work with.
    """
    return call("gtm", locals())


def lc(
    source: ArrayLike,
    target: ArrayLike,
    *,
    ratio: ArrayLike | None = None,
    resolution: float | None = None,
    tolerance: float | None = None,
    modes: int = 40,
    threads: int | None = None,
    max_memory: int | None = None,
    progress: Progress | None = None,
) -> Grouping:
    """Likelihood consensus (LC): the pose under which the correspondences are likelier than by chance.

    Not of the paper; for few right matches among many. Cliques of matches that keep their distances
    (``|ds - dt| < tolerance``) give poses. A pose scores the sum of ``max(0, L_i - r_i^2 / (2 sigma^2))``
    over residuals r_i below ``2 * tolerance``, with ``sigma = 0.9 * tolerance`` and the chance level
    ``L_i = ln(s n / D_i) + clip(8 (0.87 - ratio_i), -0.8, 3)``: D_i counts the matches that start or end
    within ``5/3 * tolerance`` of match i, and ``s = max(1/100, 10/n)`` is the share that is right where
    nothing is known. The best pose is refined, its supporters are taken out, and so on. Of more than 2,500
    correspondences, cliques are sought among the 2,500 that keep their distance to the most others (the
    diagnostics say how many under ``vertices``). Cost O(n^2) tests of pairs, memory O(n).

    Parameters
    ----------
    source, target : (n,3) array_like of float
        Matched points.
    ratio : (n,) array_like of float, optional
        Nearest / second-nearest descriptor distance; without it, all matches are alike beforehand.
    resolution : float, optional
        Mean nearest-neighbour distance of the clouds.
    tolerance : float, optional
        Greatest distance difference of two that agree, a length; default ``3 * resolution``. For dense
        matches of clouds thinned to voxels of side v, ``1.2 * v``.
    modes : int
        Most poses in `Grouping.alternatives`, the best among them.
    threads : int, optional
        Threads to compute on, None for all cores. The result does not depend on it.
    max_memory : int, optional
        Bytes that the graph of agreeing pairs may take; by default a quarter of the memory that is free, at
        most 1.5 GiB. A larger graph is refused.
    progress : callable, optional
        Called now and then with the share of the work done, in [0,1].

    Returns
    -------
    Grouping
        The correspondences with a residual of at most ``5/3 * tolerance`` under `Grouping.model`, the best
        pose. Its scores are probabilities to be right, given that pose; `Grouping.alternatives` has the other
        poses too. Without a pose that three correspondences support, the group is empty.

    Raises
    ------
    InputError
        For fields or options that the method can't work with, or where the graph exceeds `max_memory`.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import lc
    >>> rng = np.random.default_rng(0)
    >>> source = rng.uniform(0, 100, size=(500, 3))
    >>> target = source[:, [1, 2, 0]] + 5.0
    >>> target[25:] = rng.uniform(0, 100, size=(475, 3))
    >>> result = lc(source, target, resolution=1.0)
    >>> bool(result.mask[:25].all()), result.model[:3, 3].round(1)
    (True, array([5., 5., 5.]))
    """
    return call("lc", locals())
