"""The reference itself: hand-computed cases and the properties of each method."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as hst
from method_cases import CASES, Options, call_reference

from cgroup.evaluation import score_group as quality
from reference.consistency_voting import cv
from reference.game_theory import gtm
from reference.geometric_consistency import gc
from reference.hough_voting import hough3d
from reference.nearest_neighbor_ratio import nnsr
from reference.otsu import otsu_split
from reference.pairwise import distance_difference, distance_ratio
from reference.ransac import enough, ransac, sample_triples
from reference.result import ReferenceGrouping
from reference.rigid import apply, determines_rotation, kabsch
from reference.search_of_inliers import si
from reference.similarity_score import ss
from reference.spectral import st
from strategies import Problem, make_problem, moved, random_motion, random_rotations, rigid, scaled

pytestmark = pytest.mark.filterwarnings("error")

SEEDS = range(4)

ROW_BY_ROW = {"ransac", "hough3d", "teaser"}
"""Random samples, cells that tie, and TEASER++'s chain of measurements go by the order of the rows."""


def frames(problem: Problem) -> dict[str, Any]:
    return {"source_lrf": problem.source_lrf, "target_lrf": problem.target_lrf}


def quick(method: str, problem: Problem) -> ReferenceGrouping:
    return call_reference(method, problem, CASES[method].quick)


def noiseless(n: int, seed: int = 0) -> Problem:
    """Only exact inliers, with exact frames and ratios below 0.8."""
    problem = make_problem(
        np.random.default_rng(seed), n, inlier_ratio=1.0, noise=0.0, frame_error=0.0, random_frames=0.0
    )
    problem.ratio[:] *= 0.79
    return problem


# --- Otsu ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("modes", "scores", "threshold", "selected"),
    [
        # In the middle of the gap.
        (("minmax", "exact"), [0.9, 0.1, 0.0, 1.0], 0.5, "1001"),
        # The lowest of equally good cuts: J = 1 * 2 * 0.75^2 for both.
        (("minmax", "exact"), [0.0, 0.5, 1.0], 0.25, "011"),
        # Four scores: B = 2 bins, the only cut is k = 0, so t = 0 selects all but zero.
        (("covis",), [0.0, 0.2, 0.8, 0.9], 0.0, "0111"),
        # Nine scores: B = 3; J(0) = 1*8*1.5^2 = 18, J(1) = 5*4*(2 - 0.8)^2 = 28.8, t = 1/2.
        (("covis",), [0.1, 0.4, 0.4, 0.4, 0.4, 0.9, 0.9, 1.0, 7.0], 0.5, "000001111"),
        # One occupied bin: t = 0.
        (("covis",), [0.01, 0.02, 0.03, 0.04], 0.0, "1111"),
        # Minimum at 0: step 0.01, best k = 10, lower edge of that bin.
        (("legacy",), [0.0, 0.1, 0.9, 1.0], pytest.approx(0.1), "0011"),
        # Minimum far above 0: everything in the last bin, accept all.
        (("legacy",), [0.60, 0.61, 0.79, 0.80], pytest.approx(0.1), "1111"),
    ],
)
def test_otsu_by_hand(modes: Any, scores: list[float], threshold: float, selected: str) -> None:
    for mode in modes:
        mask, cut = otsu_split(np.array(scores), mode)
        assert cut == threshold
        assert mask.tolist() == [each == "1" for each in selected]


@pytest.mark.parametrize("mode", ["minmax", "exact", "covis", "legacy"])
@pytest.mark.parametrize(("value", "selected"), [(0.3, True), (1e-7, True), (0.0, False), (-0.3, False)])
def test_otsu_of_constant_scores(mode: Any, value: float, selected: bool) -> None:
    wobble = np.array([1.0, 1.0 + 1e-12, 1.0 - 1e-12])
    mask, threshold = otsu_split(value * wobble, mode)
    assert threshold is None
    assert (mask == selected).all()
    assert otsu_split(np.zeros(0), mode)[0].shape == (0,)


@given(seed=hst.integers(0, 2**32 - 1), n=hst.integers(2, 200), mode=hst.sampled_from(["minmax", "exact"]))
@settings(max_examples=40)
def test_otsu_invariances(seed: int, n: int, mode: Any) -> None:
    rng = np.random.default_rng(seed)
    scores = rng.beta(2.0, 5.0, n)
    mask, _ = otsu_split(scores, mode)
    assert mask.any()
    assert not mask.all()
    order = rng.permutation(n)
    assert (otsu_split(scores[order], mode)[0] == mask[order]).all()
    if mode == "exact" or n > 10:  # binning of few values is sensitive to rounding
        assert (otsu_split(0.25 * scores + 4.0, mode)[0] == mask).mean() > 0.98


# --- Geometry -----------------------------------------------------------------------

TRIANGLE = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0]])


def test_pairwise_terms_of_a_doubled_triangle() -> None:
    off_diagonal = ~np.eye(3, dtype=bool)
    assert (distance_ratio(TRIANGLE, 2 * TRIANGLE)[off_diagonal] == 0.5).all()
    difference = distance_difference(TRIANGLE, 2 * TRIANGLE)
    expected = [[0.0, 3.0, 4.0], [3.0, 0.0, 5.0], [4.0, 5.0, 0.0]]
    assert difference == pytest.approx(np.array(expected))


def test_zero_edges_have_ratio_zero() -> None:
    source = TRIANGLE + 1e4
    target = source[[0, 1, 1]]
    rho = distance_ratio(source, target)
    assert rho[1, 2] == rho[2, 1] == 0.0
    assert rho[0, 1] == 1.0
    assert (np.diag(rho) == 0.0).all()
    assert (distance_ratio(np.ones((3, 3)), np.ones((3, 3))) == 0.0).all()


def test_kabsch_recovers_a_motion_and_never_mirrors() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(5, 10, 3))
    true_rotation, true_translation = random_rotations(rng, 5), rng.normal(size=(5, 3))
    moved = points @ np.swapaxes(true_rotation, 1, 2) + true_translation[:, None]
    rotation, translation = kabsch(points, moved)
    assert rotation == pytest.approx(true_rotation)
    assert translation == pytest.approx(true_translation)
    assert apply(rotation[0], translation[0], points[0]) == pytest.approx(moved[0])
    mirrored, _ = kabsch(points, points * [1.0, 1.0, -1.0])
    assert np.linalg.det(mirrored) == pytest.approx(np.ones(5))


def test_rank_of_pairs() -> None:
    assert determines_rotation(TRIANGLE, TRIANGLE)
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    assert not determines_rotation(line, line)
    assert not determines_rotation(TRIANGLE[[0, 1, 1]], TRIANGLE)


# --- Sampling of RANSAC -------------------------------------------------------------


def philox4x64(counter: int, key: int) -> list[int]:
    """One block of Philox4x64-10 in plain integers (Salmon et al. 2011)."""
    low = 2**64 - 1
    x = [(counter >> 64 * word) & low for word in range(4)]
    k = [key & low, (key >> 64) & low]
    for _ in range(10):
        high = [0xD2E7470EE14C6C93 * x[0], 0xCA5A826395121157 * x[2]]
        x = [(high[1] >> 64) ^ x[1] ^ k[0], high[1] & low, (high[0] >> 64) ^ x[3] ^ k[1], high[0] & low]
        k = [(k[0] + 0x9E3779B97F4A7C15) & low, (k[1] + 0xBB67AE8584CAA73B) & low]
    return x


@pytest.mark.parametrize("seed", [0, 1, 2**64 - 1])
@pytest.mark.parametrize("iteration", [0, 1, 9999])
def test_numpy_raises_the_counter_before_the_first_block(seed: int, iteration: int) -> None:
    words = np.random.Philox(counter=iteration, key=seed).random_raw(4).tolist()
    assert words == philox4x64(iteration + 1, seed)


def test_samples_follow_their_definition() -> None:
    n, seed = 7, 42
    triples = sample_triples(n, 5, 30_000, seed)
    for row in (0, 1, 29_999):
        words = np.random.Philox(counter=5 + row, key=seed).random_raw(3).tolist()
        left = list(range(n))  # drawing without replacement, spelled out
        expected = [left.pop((w * len(left)) >> 64) for w in words]
        assert triples[row].tolist() == expected
    assert (np.sort(triples, axis=1)[:, :-1] < np.sort(triples, axis=1)[:, 1:]).all()
    share = np.bincount(triples.ravel(), minlength=n) / len(triples)
    assert share == pytest.approx(np.full(n, 3 / n), abs=0.015)  # five sigma


def test_first_samples_are_pinned() -> None:
    assert sample_triples(100, 0, 3, 0).tolist() == [[1, 24, 11], [50, 27, 94], [25, 19, 71]]


# --- Individual methods, by hand ----------------------------------------------------


def test_ss_ignores_zero_descriptors() -> None:
    similarity = np.array([-np.inf, 0.1, 0.9, 0.0, 1.0, -np.inf])
    group = ss(similarity)
    assert group.threshold == 0.5
    assert np.flatnonzero(group.mask).tolist() == [2, 4]
    assert np.flatnonzero(ss(similarity, threshold=0.9).mask).tolist() == [2, 4]
    assert not ss(np.full(3, -np.inf)).mask.any()
    assert not ss(np.full(3, -np.inf), threshold=-np.inf).mask.any()


def test_nnsr_border_belongs_to_the_group() -> None:
    ratio = np.array([0.8, np.nextafter(0.8, 1.0), 0.0, 1.0])
    group = nnsr(ratio)
    assert group.mask.tolist() == [True, False, True, False]
    assert group.scores == pytest.approx(1.0 - ratio)


def square_with_outlier() -> dict[str, Any]:
    """Return four exact correspondences and one wrong one, all frames equal."""
    source = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [10, 10, 0], [5, 5, 3.0]])
    target = source + np.array([100.0, 0.0, 0.0])
    target[4] = [105.0, 5.0, 40.0]
    same = np.tile(np.eye(3), (5, 1, 1))
    return {
        "source": source,
        "target": target,
        "ratio": np.full(5, 0.5),
        "source_lrf": same.copy(),
        "target_lrf": same.copy(),
    }


def test_si_by_hand() -> None:
    data = square_with_outlier()
    # 4 local and 4 global voters each; the outlier agrees with nobody.
    group = si(**data, tolerance=1.0)
    assert group.scores == pytest.approx(np.array([0.75, 0.75, 0.75, 0.75, 0.0]))
    assert group.mask.tolist() == [True] * 4 + [False]
    # Without frame only the local half of the votes is left.
    data["target_lrf"][1] = np.nan
    group = si(**data, tolerance=1.0)
    assert group.scores == pytest.approx(np.array([0.75, 3 / 8, 0.75, 0.75, 0.0]))
    # Only row 0 passes Lowe's test and leads the ranking: one voter for all but row 0.
    data["ratio"] = np.array([0.5, 0.8, 0.9, 0.9, 0.9])
    group = si(**data, tolerance=1.0, neighbors=1)
    # Nearest other point: 4 for all corners, 0 for row 4 (tie of four, lowest index).
    # Row 0: C_L = {}, C_G = {}; row 4: C_L = C_G = {0}, both disagree.
    assert group.scores == pytest.approx(np.array([0.0, 0.0, 1.0, 1.0, 0.0]))


def test_cv_by_hand() -> None:
    given_data = {
        "source": on_a_line([0, 20]),
        "target": on_a_line([0, 30]),
        "ratio": np.array([0.1, 0.2]),
        "source_lrf": np.array([np.eye(3), np.eye(3)]),
        "target_lrf": np.array([np.eye(3), rigid((0, 0, 1), 10.0)[:3, :3]]),
        "distance_scale": 10.0,
    }
    # delta = 10 and L = 10 degrees: D = exp(-1 - 1).
    group = cv(**given_data, voters=1)
    assert group.scores == pytest.approx(np.array([1.0, np.exp(-2.0)]))
    group = cv(**given_data, angle_scale=20.0, exclude_self=True)
    assert group.scores == pytest.approx(np.full(2, np.exp(-1.25)))
    assert group.mask.all()  # constant positive scores
    given_data["source_lrf"][0] = np.nan
    assert cv(**given_data).scores == pytest.approx(np.array([0.0, 1.0]))


# --- Group methods, by hand ---------------------------------------------------------


def test_ransac_refits_once() -> None:
    problem = make_problem(np.random.default_rng(3), 80, inlier_ratio=0.4, noise=1.0)
    points = problem.source, problem.target
    plain = ransac(*points, resolution=1.0, iterations=1000)
    assert plain.details["best_count"] == plain.mask.sum()
    refined = ransac(*points, resolution=1.0, iterations=1000, refine=True)
    rotation, translation = kabsch(problem.source[plain.mask], problem.target[plain.mask])
    error = np.linalg.norm(apply(rotation, translation, problem.source) - problem.target, axis=1)
    assert (refined.mask == (error < 5.0)).all()
    assert refined.details["transform"] == pytest.approx(problem.T_target_source, rel=0.1, abs=1.0)


def test_early_stop_rule() -> None:
    assert enough(256, 1.0, 0.5)
    assert not enough(255, 1.0, 0.5)
    assert not enough(256, 0.0, 0.5)
    # log(0.01) / log(1 - 0.2^3) = 573.4: the third check.
    assert [enough(256 * k, 0.2, 0.99) for k in (1, 2, 3)] == [False, False, True]


def test_ransac_needs_three_points_that_are_not_in_line() -> None:
    line = np.outer(np.arange(6.0), [1.0, 2.0, 3.0])
    assert not ransac(line, line, tolerance=1.0, iterations=100).mask.any()
    assert ransac(TRIANGLE, TRIANGLE, tolerance=1.0, iterations=1).mask.all()


def test_st_of_two() -> None:
    source = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    for stretch, expected in ((1.5, [True, True]), (2.0, [True, False])):
        group = st(source, source * stretch)
        assert group.mask.tolist() == expected
        assert group.scores == pytest.approx(np.full(2, np.sqrt(0.5)))
    assert not st(source, source * 0.0).mask.any()
    assert not st(source[:1], source[:1], diagonal="one").mask.any()


def test_st_scores_are_an_eigenvector() -> None:
    problem = make_problem(np.random.default_rng(5), 60, noise=1.0)
    for affinity in ("raw", "threshold", "binary"):
        power = st(problem.source, problem.target, affinity=affinity)
        dense = st(problem.source, problem.target, affinity=affinity, eigensolver="dense")
        assert power.scores == pytest.approx(dense.scores, abs=1e-8)
        matrix, v = power.details["matrix"], power.scores
        assert matrix @ v == pytest.approx((v @ matrix @ v) * v, abs=1e-6)


def on_a_line(positions: list[float]) -> np.ndarray:
    return np.array([[x, 0.0, 0.0] for x in positions])


def test_gc_star_by_hand() -> None:
    source, target = on_a_line([0, 1, 2, 3]), on_a_line([0, 1, 2, 10])
    group = gc(source, target, tolerance=0.5)
    assert group.scores.tolist() == [3.0, 3.0, 3.0, 1.0]
    assert group.mask.tolist() == [True, True, True, False]
    # Strict: 0 and 3 differ by exactly 7.
    assert gc(source, target, tolerance=7.0).scores.tolist() == [3, 3, 3, 1]
    # Two clusters of two, all four at different scales.
    target = on_a_line([0, 1, 102, 103])
    lowest = gc(source, target, tolerance=0.5)
    union = gc(source, target, tolerance=0.5, ties="union")
    assert lowest.mask.tolist() == [True, True, False, False]
    assert union.mask.all()


def test_gc_clique_takes_the_largest_filtered_set() -> None:
    rng = np.random.default_rng(0)
    source = rng.normal(size=(12, 3)) * 10.0
    target = source.copy()
    target[8:] = source[8:] + np.array([0.0, 0.0, 50.0])
    group = gc(source, target, tolerance=1e-3, variant="clique", iterations=50)
    assert [members.tolist() for members in group.details["sets"]] == [list(range(8)), list(range(8, 12))]
    assert np.flatnonzero(group.mask).tolist() == list(range(8))
    similarity = (np.arange(12) >= 8).astype(float)
    group = gc(source, target, tolerance=1e-3, variant="clique", iterations=50, similarity=similarity)
    assert [members.tolist() for members in group.details["sets"]] == [list(range(8, 12)), list(range(8))]
    assert not gc(source, target, tolerance=1e-3, variant="clique", min_cluster_size=8).mask.any()


def hough_line(target_x: list[float]) -> dict[str, Any]:
    """Return correspondences from the origin whose votes are the target points."""
    n = len(target_x)
    same = np.tile(np.eye(3), (n, 1, 1))
    return {
        "source": np.zeros((n, 3)),
        "target": on_a_line(target_x),
        "source_lrf": same,
        "target_lrf": same.copy(),
        "source_centroid": np.zeros(3),
    }


def test_hough_grid_by_hand() -> None:
    # 15 bins of side 1 on x: bins 0, 0, 1, 2, 14; y and z are flat.
    data = hough_line([0.0, 0.5, 1.5, 2.5, 15.0])
    group = hough3d(**data)
    assert group.details["cells"][:, 0].tolist() == [0, 0, 1, 2, 14]
    assert group.mask.tolist() == [True, True, True, False, False]
    assert hough3d(**data, neighbors=0).mask.tolist() == [*[True, True, False, False, False]]
    # Three bins of side 5: 0, 0, 0, 0, 2; the border belongs to the last bin.
    assert hough3d(**data, bins=3).details["cells"][:, 0].tolist() == [*[0, 0, 0, 0, 2]]
    # Cubes of side 5: floor(15/5) + 1 = 4 bins.
    assert hough3d(**data, bin_size=5.0).details["cells"][:, 0].tolist() == [*[0, 0, 0, 0, 3]]
    data["source_lrf"][0] = np.nan
    assert not hough3d(**data).mask[0]


def test_hough_votes_undo_the_frames() -> None:
    problem = noiseless(20)
    group = hough3d(
        problem.source, problem.target, source_centroid=problem.source_centroid, **frames(problem)
    )
    transform = problem.T_target_source
    moved = transform[:3, :3] @ problem.source_centroid + transform[:3, 3]
    votes = group.details["votes"] + problem.target.mean(axis=0)
    assert votes == pytest.approx(np.tile(moved, (20, 1)))
    assert group.mask.all()


def test_hough_pcl_by_hand() -> None:
    data = hough_line([0.0, 0.2, 0.4, 2.5, 3.5])
    group = hough3d(**data, variant="pcl", bin_size=1.0, interpolation=False)
    space = group.details["space"]
    # ceil(3.5) = 4 bins on x, one on the flat axes.
    assert {cell: set(voters) for cell, voters in space.items()} == {
        (0, 0, 0): {0, 1, 2},
        (2, 0, 0): {3},
        (3, 0, 0): {4},
    }
    assert not group.mask.any()  # coincident source points fix no motion
    # Flat axes: position 0 is half a bin below the first centre, so half the weight is
    # lost on y and z each. Row 3 at 2.5 is the centre of bin 2: one bin gets all.
    space = hough3d(**data, variant="pcl", bin_size=1.0).details["space"]
    assert space[2, 0, 0] == {3: 0.25}
    assert space[0, 0, 0] == pytest.approx({0: 0.125, 1: 0.7 / 4, 2: 0.9 / 4})
    # Range an exact multiple of the side: the upper border is outside.
    data = hough_line([0.0, 2.0])
    for interpolation in (True, False):
        space = hough3d(**data, variant="pcl", bin_size=1.0, interpolation=interpolation).details["space"]
        assert 1 not in set().union(*space.values())


def isosceles(third: float) -> tuple[np.ndarray, np.ndarray]:
    """Return triangles with rho_01 = 1 and rho_02 = rho_12 = 1 / third."""
    height = np.sqrt(0.75)
    source = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, height, 0.0]])
    target = source.copy()
    target[2] = [0.5, np.sqrt(third**2 - 0.25), 0.0]
    return source, target


def test_gtm_one_step_by_hand() -> None:
    # Pi x = (1.5, 1.5, 1) / 3, x' Pi x = 4/9, so x becomes (3/8, 3/8, 1/4).
    group = gtm(*isosceles(2.0), iterations=1)
    assert group.scores == pytest.approx(np.array([0.375, 0.375, 0.25]))
    assert group.threshold == pytest.approx(0.3125)
    assert group.mask.tolist() == [True, True, False]


def test_gtm_payoffs() -> None:
    source, target = isosceles(2.0)
    pi = gtm(source, target, payoff="distance_difference", tolerance=0.5).details["payoff"]
    assert pi.tolist() == [[0, 1, 0], [1, 0, 0], [0, 0, 0]]
    target[1] = target[0]
    for one_to_one, expected in ((False, 1.0), (True, 0.0)):
        pi = gtm(source, target, payoff="distance_difference", tolerance=1.0, one_to_one=one_to_one).details[
            "payoff"
        ]
        assert pi[0, 1] == expected


def test_infection_immunisation_finds_the_equilibrium() -> None:
    # {0, 1} play 1/2 each and earn 1/2; strategy 2 earns 0.4 against them.
    group = gtm(*isosceles(2.5), dynamics="infection_immunisation")
    assert group.scores == pytest.approx(np.array([0.5, 0.5, 0.0]), abs=1e-7)
    assert group.mask.tolist() == [True, True, False]
    problem = make_problem(np.random.default_rng(2), 60, inlier_ratio=0.5, noise=1.0)
    group = gtm(problem.source, problem.target, dynamics="infection_immunisation", iterations=20_000)
    x, pi = group.scores, group.details["payoff"]
    mean = x @ pi @ x
    assert group.details["iterations"] < 20_000
    assert x.sum() == pytest.approx(1.0)
    assert (pi @ x)[x > 1e-9] == pytest.approx(mean, rel=1e-6)  # Nash: all earn the same
    assert ((pi @ x) <= mean * (1.0 + 1e-6)).all()  # and nobody could earn more


@pytest.mark.parametrize("seed", SEEDS)
def test_gtm_population_and_payoff(seed: int) -> None:
    problem = make_problem(np.random.default_rng(seed), 50)
    earlier = 0.0
    for iterations in (0, 1, 2, 5, 20, 100):
        group = gtm(problem.source, problem.target, iterations=iterations)
        x = group.scores
        assert x.sum() == pytest.approx(1.0)
        assert (x >= 0.0).all()
        payoff = x @ group.details["payoff"] @ x
        assert payoff >= earlier * (1.0 - 1e-12)
        earlier = payoff
    loose = gtm(problem.source, problem.target, convergence_tolerance=0.1)
    assert 0 < loose.details["iterations"] < 100


# --- Properties of all methods ------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("method", sorted(set(CASES) - ROW_BY_ROW))
def test_permutation_equivariance(method: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem = make_problem(rng, 60, repeated_targets=0.0, missing_frames=0.1)
    order = rng.permutation(60)
    group, permuted = quick(method, problem), quick(method, problem.subset(order))
    if group.scores is not None:
        accuracy = max(1e-9, CASES[method].score_tolerance)
        assert permuted.scores == pytest.approx(group.scores[order], rel=1e-8, abs=accuracy)
    assert (permuted.mask == group.mask[order]).all()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("method", sorted(CASES))
def test_invariance_to_rigid_motion_and_scale(method: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem = make_problem(rng, 60, missing_frames=0.1)
    source_motion, target_motion = random_motion(rng, 500.0), random_motion(rng, 500.0)
    if method in {
        "hough3d",
        "teaser",
    }:  # its grid, or its vote for the translation, goes by the target's axes
        target_motion[:3, :3] = np.eye(3)
    group = quick(method, problem)
    after = quick(method, moved(problem, source_motion, target_motion))
    assert (after.mask == group.mask).all()
    if group.scores is not None:
        assert after.scores == pytest.approx(group.scores, rel=1e-7, abs=1e-9)
    for factor in (1e-3, 1e3):
        assert (quick(method, scaled(problem, factor)).mask == group.mask).all()


@pytest.mark.parametrize("method", ["si", "ransac", "st", "gc", "hough3d", "gtm"])
def test_exact_inliers_are_all_selected(method: str) -> None:
    assert quick(method, noiseless(40)).mask.all()


def test_cv_is_symmetric_in_the_sides() -> None:
    p = make_problem(np.random.default_rng(4), 50, missing_frames=0.2)
    forth = cv(p.source, p.target, ratio=p.ratio, resolution=1.0, **frames(p))
    back = cv(
        p.target, p.source, ratio=p.ratio, resolution=1.0, source_lrf=p.target_lrf, target_lrf=p.source_lrf
    )
    assert back.scores == pytest.approx(forth.scores, rel=1e-12)


# --- The paper's table -------------------------------------------------------------


@pytest.fixture(scope="module")
def large() -> dict[float, Problem]:
    return {
        share: make_problem(np.random.default_rng(0), 1000, inlier_ratio=share, noise=1.75, clutter=clutter)
        for share, clutter in ((0.5, 0.0), (0.23, 0.0), (0.08, 0.0), (0.03, 0.7))
    }


@pytest.mark.parametrize(
    ("method", "share", "at_least"),
    [
        ("nnsr", 0.5, (0.7, 0.6)),
        ("nnsr", 0.23, (0.4, 0.6)),
        ("gtm", 0.5, (0.95, 0.75)),
        ("gtm", 0.23, (0.9, 0.75)),
        ("gtm", 0.08, (0.9, 0.75)),
        ("gtm", 0.03, (0.8, 0.75)),
        ("st", 0.5, (0.9, 0.85)),
        ("st", 0.23, (0.85, 0.85)),
        ("gc", 0.5, (0.85, 0.85)),
        ("gc", 0.03, (0.3, 0.8)),
        ("cv", 0.5, (0.9, 0.5)),
        ("cv", 0.23, (0.85, 0.5)),
        ("si", 0.5, (0.9, 0.6)),
        ("si", 0.23, (0.85, 0.6)),
        ("hough3d", 0.5, (0.85, 0.4)),
        ("ransac", 0.5, (0.95, 0.9)),
        ("ransac", 0.23, (0.95, 0.8)),
    ],
)
def test_table_of_section_13(
    large: dict[float, Problem], method: str, share: float, at_least: tuple[float, float]
) -> None:
    problem = large[share]
    options: dict[str, Options] = {"ransac": {"iterations": 1500}, "hough3d": {"source_centroid": None}}
    group = call_reference(method, problem, options.get(method, {}))
    q = quality(group.mask, problem.inlier_mask)
    assert (q.precision >= at_least[0], q.recall >= at_least[1]) == (True, True)


def test_readings_that_section_13_tells_apart(large: dict[float, Problem]) -> None:
    problem = large[0.5]
    points = problem.source, problem.target

    def recall(group: ReferenceGrouping) -> float:
        return quality(group.mask, problem.inlier_mask).recall

    assert recall(nnsr(problem.ratio, max_ratio=0.2)) < 0.02
    assert recall(gtm(*points, iterations=500)) < 0.6
    assert st(*points, conflict="one_to_one").mask.mean() > 0.85
    assert recall(gc(*points, resolution=1.0)) > 0.85
    narrow = {"resolution": 1.0, "variant": "clique", "iterations": 500}
    assert recall(gc(*points, **narrow)) < 0.5
    assert recall(hough3d(*points, bin_size=10.0, **frames(problem))) < 0.4
