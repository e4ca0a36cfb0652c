"""Methods that judge matches one by one: section 3.1 of Yang et al., TPAMI 2019 ("the paper")."""

from __future__ import annotations

from cgroup.methods._declare import method


@method(
    "ss",
    label="SS",
    idea="alike descriptors",
    complexity="n",
    color="#DDCC77",
    marker="o",
    citation="Yang et al., TPAMI 2019",
    in_paper=True,
    individual=True,
    notes={"similarity": "-inf is never selected."},
)
def ss() -> None:
    """Similarity score (SS): keep correspondences whose descriptors are similar.

    Section 3.1, Eq. (1) of Yang et al., TPAMI 2019. Cost O(n), on one thread.

    Returns
    -------
    Grouping
        Its scores are the similarities, `Grouping.threshold` the cut. Without points, so that
        `Grouping.transform` needs `cgroup.group`.

    Examples
    --------
    >>> from cgroup import ss
    >>> group = ss([0.95, 0.2, 0.9, 0.25, 0.88])
    >>> group.mask
    array([ True, False,  True, False,  True])
    >>> ss([0.95, 0.2, 0.9, 0.25, 0.88], threshold=0.9).indices
    array([0, 2])
    """


@method(
    "nnsr",
    label="NNSR",
    idea="distinct descriptors",
    complexity="n",
    color="#999933",
    marker="s",
    citation="Lowe, IJCV 2004",
    in_paper=True,
    individual=True,
)
def nnsr() -> None:
    """Nearest-neighbour similarity ratio (NNSR): keep the distinctive correspondences.

    Section 3.1, Eq. (2) of Yang et al., TPAMI 2019, after Lowe, IJCV 2004. The printed bound 0.8 on ``1 -
    d1/d2`` is Lowe's bound on ``d1/d2``; ``max_ratio=0.2`` is the formula read to the letter. Cost O(n), on
    one thread.

    Returns
    -------
    Grouping
        Its scores are ``1 - ratio``. Without points, so that `Grouping.transform` needs `cgroup.group`.

    Examples
    --------
    >>> from cgroup import nnsr
    >>> nnsr([0.3, 0.95, 0.7]).mask
    array([ True, False,  True])
    >>> nnsr([0.3, 0.95, 0.7], max_ratio=0.5).mask
    array([ True, False, False])
    """


@method(
    "si",
    label="SI",
    idea="votes under its own pose",
    complexity="n log n + n k",
    color="#88CCEE",
    marker="^",
    citation="Buch et al., CVPR 2014",
    in_paper=True,
    individual=True,
)
def si() -> None:
    """Search of inliers (SI): votes of neighbours, then of the most distinctive.

    Section 3.1, Eq. (3) to (6) of Yang et al., TPAMI 2019, after Buch et al., CVPR 2014. Cost O(n log n + n
    neighbors).

    Returns
    -------
    Grouping
        Its scores are shares of votes, in [0,1], and `Grouping.threshold` is the cut on them.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import si
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 500, inlier_ratio=0.3)
    >>> fields = ("source", "target", "ratio", "source_lrf", "target_lrf", "resolution")
    >>> group = si(**{name: getattr(problem, name) for name in fields})
    >>> precision = problem.inlier_mask[group.mask].mean()
    >>> bool(precision > 0.9)  # 30 % of all matches are right
    True
    """


@method(
    "cv",
    label="CV",
    idea="votes by distance, frame",
    complexity="n k",
    color="#44AA99",
    marker="v",
    citation="Yang et al., 2019",
    in_paper=True,
    individual=True,
)
def cv() -> None:
    """Consistency voting (CV): votes of the most distinctive correspondences.

    Section 3.1, Eq. (7) to (11) of Yang et al., TPAMI 2019, after Yang et al., 2019. A vote falls with the
    difference of the distances, and with that of the angles between the frames. Cost O(n voters).

    Returns
    -------
    Grouping
        Its scores are sums of votes, in [0, voters], and `Grouping.threshold` is the cut on them.

    Examples
    --------
    >>> import numpy as np
    >>> from cgroup import cv
    >>> from cgroup.datasets import make_problem
    >>> problem = make_problem(np.random.default_rng(0), 500, inlier_ratio=0.3)
    >>> fields = ("source", "target", "ratio", "source_lrf", "target_lrf", "resolution")
    >>> group = cv(**{name: getattr(problem, name) for name in fields})
    >>> precision = problem.inlier_mask[group.mask].mean()
    >>> bool(precision > 0.9)  # 30 % of all matches are right
    True
    """
