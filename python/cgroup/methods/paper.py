"""The methods of Yang et al., TPAMI 2019: one by one (section 3.1), and together (section 3.2)."""

from cgroup.methods._declare import method

_RECOMPUTED = "A larger matrix is recomputed row by row, with the same result."

_FACTS = {  # label, idea, cost in n matches, color and marker, source
    "ss": ("SS", "alike descriptors", "n", "#DDCC77 o", "Yang et al., TPAMI 2019"),
    "nnsr": ("NNSR", "distinct descriptors", "n", "#999933 s", "Lowe, IJCV 2004"),
    "si": ("SI", "votes under its own pose", "n log n + n k", "#88CCEE ^", "Buch et al., CVPR 2014"),
    "cv": ("CV", "votes by distance, frame", "n k", "#44AA99 v", "Yang et al., 2019"),
    "ransac": (
        "RANSAC", "best of random triples", "n iterations", "#117733 D", "Fischler, Bolles, CACM 1981",
    ),
    "st": ("ST", "principal eigenvector", "n² per power step", "#AA4499 P", "Leordeanu, Hebert, ICCV 2005"),
    "gc": ("GC", "largest star of a seed", "n²", "#882255 X", "Chen, Bhanu, PRL 2007"),
    "3dhv": ("3DHV", "votes for the centre", "n log n", "#CC6677 <", "Tombari, Di Stefano, PSIVT 2010"),
    "gtm": ("GTM", "survivors of a game", "n² per step", "#332288 *", "Rodola et al., IJCV 2013"),
}  # fmt: skip


@method("ss", _FACTS, individual=True, notes={"similarity": "-inf is never selected."})
def ss() -> None:
    """Similarity score (SS): keep correspondences whose descriptors are similar.

    Section 3.1, Eq. (1) of Yang et al., TPAMI 2019. Cost O(n), on one thread.

    Its scores are the similarities, `Grouping.threshold` the cut. Without points, so that
    `Grouping.transform` needs `cgroup.group`.

    Examples
    --------
    >>> group = ss([0.95, 0.2, 0.9, 0.25, 0.88])
    >>> group.mask
    array([ True, False,  True, False,  True])
    >>> ss([0.95, 0.2, 0.9, 0.25, 0.88], threshold=0.9).indices
    array([0, 2])
    """


@method("nnsr", _FACTS, individual=True)
def nnsr() -> None:
    """Nearest-neighbour similarity ratio (NNSR): keep the distinctive correspondences.

    Section 3.1, Eq. (2) of Yang et al., TPAMI 2019, after Lowe, IJCV 2004. The printed bound 0.8 on ``1 -
    d1/d2`` is Lowe's bound on ``d1/d2``; ``max_ratio=0.2`` is the formula read to the letter. Cost O(n), on
    one thread.

    Its scores are ``1 - ratio``. Without points, so that `Grouping.transform` needs `cgroup.group`.

    Examples
    --------
    >>> nnsr([0.3, 0.95, 0.7]).mask
    array([ True, False,  True])
    >>> nnsr([0.3, 0.95, 0.7], max_ratio=0.5).mask
    array([ True, False, False])
    """


@method("si", _FACTS, individual=True)
def si() -> None:
    """Search of inliers (SI): votes of neighbours, then of the most distinctive.

    Section 3.1, Eq. (3) to (6) of Yang et al., TPAMI 2019, after Buch et al., CVPR 2014. Cost O(n log n + n
    neighbors).

    Its scores are fractions of votes, in [0,1], and `Grouping.threshold` is the cut on them.
    """


@method("cv", _FACTS, individual=True)
def cv() -> None:
    """Consistency voting (CV): votes of the most distinctive correspondences.

    Section 3.1, Eq. (7) to (11) of Yang et al., TPAMI 2019, after Yang et al., 2019. A vote falls with the
    difference of the distances, and with that of the angles between the frames. Cost O(n voters).

    Its scores are sums of votes, in [0, voters], and `Grouping.threshold` is the cut on them.
    """


@method("ransac", _FACTS)
def ransac() -> None:
    """Random sample consensus (RANSAC): the sampled motion with the most inliers.

    Section 3.2 of Yang et al., TPAMI 2019, after Fischler, Bolles, CACM 1981: a sample is three
    correspondences, its motion their least-squares transform. Samples are rows, so that the order of the rows
    changes them, as another `seed` does. Cost O(iterations n).

    Its `model` is the transform (4,4) of the selection. Without any inlier the group is empty.
    """


@method("st", _FACTS, notes={"similarity": 'Needed for ``diagonal="score"``.', "max_memory": _RECOMPUTED})
def st() -> None:
    """Spectral technique (ST): the main cluster of the pairwise affinity matrix.

    Section 3.2, Eq. (12) of Yang et al., TPAMI 2019, after Leordeanu, Hebert, ICCV 2005: correspondences are
    accepted in the order of their entries in the principal eigenvector, each unless it conflicts with one
    accepted before. Cost O(n^2) per power step.

    Its scores are the entries of the principal eigenvector.
    """


@method(
    "gc",
    _FACTS,
    notes={
        "similarity": "For the order of the clique variant.",
        "max_memory": "For the clique variant, whose consistent pairs take n^2 / 8 bytes; beyond the limit "
        "pairs are recomputed, with the same result.",
    },
)
def gc() -> None:
    """Geometric consistency (GC): the largest cluster that keeps distances to a seed.

    Section 3.2, Eq. (13) of Yang et al., TPAMI 2019, after Chen, Bhanu, PRL 2007. Of equally large clusters
    that of the first row is taken, so that the group may depend on the order of the rows. Cost O(n^2) time,
    O(n) memory.

    Its scores are the sizes of the star clusters (star variant).
    """


@method(
    "3dhv",
    _FACTS,
    notes={
        "similarity": "Needed for `distance_weight`.",
        "source_centroid": "Without it, the mean of `source` is used, and `diagnostics` has "
        "``centroid_from_keypoints``.",
        "lrf": "A match without frames casts no vote.",
    },
)
def hough3d() -> None:
    """3D Hough voting (3DHV): votes for the source's centroid in the target.

    Section 3.2, Eq. (14) to (16) of Yang et al., TPAMI 2019, after Tombari, Di Stefano, PSIVT 2010. Cost O(n
    log n).

    The voters of the fullest bin and its neighbours; without scores.
    """


@method("gtm", _FACTS, notes={"resolution": "For the second payoff.", "max_memory": _RECOMPUTED})
def gtm() -> None:
    """Game theory matching (GTM): correspondences that agree with survivors survive.

    Section 3.2, Eq. (17) and (18) of Yang et al., TPAMI 2019, after Rodola et al., IJCV 2013. Payoffs of more
    than 1,024 correspondences are rounded to 16 bits, by 8e-6 at most. Cost O(n^2) per step.

    Its scores are the population shares, which sum to 1, and `Grouping.threshold` is the cut on them.
    """
