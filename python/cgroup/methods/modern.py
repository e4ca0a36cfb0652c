"""Methods that came after the paper: those of other authors since 2020, and LC of this library."""

from cgroup.methods._declare import method

_REFUSED = "A larger graph is refused."

_FACTS = {  # label, idea, cost in n matches, color and marker, source
    "lc": ("LC", "pose that beats chance", "n²", "#000000 h", "this library"),
    "mac": ("MAC", "every maximal clique", "n² + cliques", "#0077BB 8", "Zhang et al., CVPR 2023"),
    "sc2pcr": ("SC2-PCR", "sets with common others", "n²", "#E69F00 >", "Chen et al., CVPR 2022"),
    "turboreg": ("TurboReg", "triangles on heavy pairs", "n²", "#56B4E9 p", "Yan et al., ICCV 2025"),
    "teaser": (
        "TEASER++", "clique, truncated fit", "n² + search", "#E8601C H", "Yang, Shi, Carlone, T-RO 2021",
    ),
    "clipper": (
        "CLIPPER", "densest agreeing set", "n² + agreeing pairs per step", "#4EB265 d",
        "Lusk, Fathian, How, ICRA 2021",
    ),
}  # fmt: skip


@method(
    "lc",
    _FACTS,
    notes={
        "ratio": "Without it, all matches are equally likely beforehand.",
        "lrf": "A match without frames is judged by its position.",
        "resolution": "A resolution that is wrong by a factor of 4 gives the same pose.",
        "max_memory": _REFUSED,
    },
)
def lc() -> None:
    """Likelihood consensus (LC): the pose that makes matches likelier than chance.

    For few right matches among many; a method of this library. Cliques of matches that keep their distances
    give poses. The support of a pose is the sum of ``max(0, L_i - r_i^2 / (2 sigma^2))`` over its residuals
    r_i, where the chance level L_i depends on the matches around match i and on its `ratio`. The best pose is
    refined, its supporters are removed, and so on. Of more than 2,500 correspondences, cliques are sought
    among the 2,500 that keep their distance to the most others (``vertices`` in the diagnostics). Cost O(n^2)
    tests of pairs, memory O(n). https://cgroup-project.github.io/cgroup/methods/lc.html has all equations.

    Frames give further poses and count in the support if they are reliable: if those of most supporters of
    significant poses agree, or if positions alone give no significant pose (``by_frames`` in the
    diagnostics).

    The correspondences with a residual of at most ``5/3 * tolerance`` under `Grouping.model`, the best pose;
    without a tolerance, of at most a radius that follows from the residuals. Its scores are probabilities to
    be right, given that pose; `Grouping.alternatives` has the other poses too. `Grouping.false_alarms` is
    infinite if a mirror image fits as well. The diagnostics have ``dimensions``, whether the group's points
    span a body (3), a plane (2) or a line (1), and ``resolution``, a fifth of the radius. Without a pose that
    three correspondences support, the group is empty. With a scale s, the model and the alternatives are
    similarities, ``s R`` in their upper left, all of the same s, ``scale`` in the diagnostics;
    `Grouping.transform` remains a rigid motion.
    """


@method(
    "mac",
    _FACTS,
    notes={
        "max_seconds": "End the search for cliques after this time, with the cliques found by then. Only "
        "then does the result depend on the machine and on the number of threads.",
        "max_memory": "A larger graph keeps only the vertices of the highest degrees.",
    },
)
def mac() -> None:
    """Maximal cliques (MAC): the best motion that cliques of agreeing matches propose.

    Zhang et al., *3D Registration with Maximal Cliques*, CVPR 2023, section 3; Yang et al., TPAMI 2024. Two
    correspondences agree if the difference of their distances is at most `max_distance_difference`. The
    weight of a pair grows with the number of others that agree with both (second order). A dense graph is
    reduced to the vertices with the greatest clustering coefficients. All maximal cliques are sought; each
    vertex keeps the heaviest one, and each clique that was kept proposes its least-squares motion. The best
    has the greatest sum of ``1 - r / tolerance`` over the residuals ``r < tolerance``.

    Cost O(n^2) tests of pairs, a step for each path of two edges, and the cliques. Memory 14 bytes for each
    of the two directions of a pair that agrees.

    The correspondences with a residual below `tolerance` under `Grouping.model`. The score of a
    correspondence is the weight of the heaviest clique that contains it, 0 where none does. Without a clique
    that fixes a motion, the group is empty. Diagnostics: ``vertices`` of the graph, ``reduced_vertices``
    among which cliques were sought, ``cliques`` found, ``hypotheses`` judged; and ``truncated`` where the
    search ended at `max_cliques` or `max_seconds`, or where the graph has only the vertices of the highest
    degrees, because all would exceed `max_memory` or 2^30 paths.
    """


@method(
    "sc2pcr",
    _FACTS,
    notes={
        "candidates": "Such as those of its 100 nearest descriptors (`cgroup.features.match`, k=100). The "
        "pose is then chosen as in SC2-PCR++ (Chen et al., TPAMI 2023): each of the 50 poses "
        "with the most inliers is refined by one round. Source points that it moves within "
        "`tolerance` of a candidate take the first one within ``1.5 * tolerance``, and the "
        "score of the pose is the most of them that are compatible, at half the bound, with one "
        "of them. The published `k1` and `k2` are 20 and 10 then.",
        "max_memory": "A compatibility matrix (n^2 bytes) that is larger is recomputed for each power step. "
        "Where the graph of compatible pairs (n^2 / 8 bytes) is larger, only the most confident "
        "correspondences whose graph fits give seeds and sets: `Grouping.complete` is False, "
        'and ``diagnostics["vertices"]`` is their number.',
    },
)
def sc2pcr() -> None:
    """SC2-PCR: correspondences that agree with the same others follow the same motion.

    Chen, Sun, Yang, Tao, "SC2-PCR: A Second Order Spatial Compatibility for Efficient and
    Robust Point Cloud Registration", CVPR 2022, section 3. Two correspondences are compatible where
    ``|ds - dt|`` is below `max_distance_difference`; their second-order compatibility is the number of others
    that are compatible (at half that bound) with both. Seeds are the correspondences with the highest
    confidence, their entry in the principal eigenvector of the compatibility. Around each seed a consensus
    set is built in two stages; the weighted least-squares pose of a set with the most inliers is refined.
    Ties go to the lowest row, so that the group may depend on the order of the rows. Cost O(n^2) per power
    step, and O(n^3 / 64) for the fraction of pairs that are compatible.

    The inliers of `Grouping.model`, the refined pose. Its scores are the confidences. Where no set fixes a
    pose the group is empty.
    """


@method(
    "turboreg",
    _FACTS,
    notes={
        "max_memory": "Where the graph of compatible pairs (n^2 / 8 bytes) is larger, only the "
        "correspondences that are compatible with the most others, as many as fit, give "
        'triangles: `Grouping.complete` is False, and ``diagnostics["vertices"]`` is their '
        "number."
    },
)
def turboreg() -> None:
    """TurboReg: poses of triangles around the pairs that agree with the same others.

    Yan, Shi, Zhao, Wang, Cao, Wu, Li, "TurboReg: TurboClique for Robust and Efficient Point
    Cloud Registration", ICCV 2025, section 3. Two correspondences are compatible where ``|ds - dt|`` is below
    `max_distance_difference`, a bound far below the tolerance, and ``ds + dt`` exceeds `nms_radius`; the
    weight of such a pair is the number of others that are compatible with both. The heaviest pairs are
    pivots, and each gives the triangles of greatest weight. The pose of a triangle that is the best by
    `choice` is refined. Ties go to the lowest row, so that the group may depend on the order of the rows.
    Cost O(n^2) tests of pairs, and O(n^3 / 64) for the fraction of pairs that are compatible.

    The inliers of `Grouping.model`, the refined pose. Without any triangle the group is empty.
    """


@method("teaser", _FACTS, notes={"max_memory": _REFUSED})
def teaser() -> None:
    """TEASER++: truncated least squares, after pruning those that disagree in pairs.

    Yang, Shi, Carlone, *TEASER: Fast and certifiable point cloud registration*, T-RO 2021, with the pruning
    by core numbers of ROBIN (ICRA 2021) and KISS-Matcher (ICRA 2025). Two correspondences are joined where
    ``|ds - dt| < max_distance_difference`` and ``0 < ds + dt`` (section IV). The rotation is that of
    graduated non-convexity on the differences of each kept point to the next (section VII), the translation
    that of adaptive voting along each axis (section V), in units of the tolerance. Each point's next one, and
    the choice among several maximum cliques, depend on the order of the rows, and so may the group. Cost
    O(n^2) tests of pairs, memory n^2 / 8 bytes.

    Those kept by the pruning whose residual under `Grouping.model` is at most `tolerance` along each axis of
    the target; without three kept that fix a rotation, none. With an estimated scale s the model is a
    similarity, ``s R`` in its upper left; s is ``scale`` in the diagnostics, and `Grouping.transform` remains
    a rigid motion, without the scale. Diagnostics: ``kept``, the number left by the pruning, and ``steps``.
    ``truncated`` is 1 where the search for a clique ran out of steps, so that the clique is the largest
    found, or where the scale is estimated from a sample of the pairs.
    """


@method(
    "clipper",
    _FACTS,
    notes={"max_memory": f"{_REFUSED} Affinities that don't fit are recomputed in each step."},
)
def clipper() -> None:
    """CLIPPER: the densest set of correspondences that all agree with each other.

    Lusk, Fathian, How, ICRA 2021 (Algorithm 1), with the certificate of CLIPPER+ (Fathian,
    Summers, RA-L 2024). Affinities ``M_ij = exp(-(ds - dt)^2 / (2 deviation^2))`` of pairs with ``|ds - dt| <
    max_distance_difference`` that share no point; two others exclude each other. Projected gradient ascent
    maximizes ``u' M u`` for ``u >= 0``, ``|u| = 1``, with a penalty on excluded pairs that grows until
    none is left. The group has the ``round(u' M u)`` correspondences of the greatest u. Rounding, which
    depends on the order of the rows, may decide between nearly equal sets. Cost O(n^2) tests of pairs and
    O(pairs that agree) per step; memory n^2 / 8 bytes, and 4 per agreeing ordered pair where that fits.

    The selected set, and its least-squares motion as `Grouping.model`; fewer than three, or a set on one
    line, are no group. The scores are u. `diagnostics`: ``objective`` is ``u' M u``, ``rounds`` the number of
    penalties, and ``certified`` 1 where the set is proved to be a clique that no other exceeds in size: it
    has as many members as the greatest core number plus one, or as a colouring has colours. If 1,000 rounds,
    or a penalty of 1e9, were not enough, ``truncated`` is 1.
    """
