"""The reference itself: cases computed by hand."""

from typing import Any

import numpy as np
import pytest

from reference.consistency_voting import cv
from reference.game_theory import gtm
from reference.geometric_consistency import gc
from reference.hough_voting import hough3d
from reference.nearest_neighbor_ratio import nnsr
from reference.otsu import otsu_split
from reference.ransac import enough, ransac
from reference.search_of_inliers import si
from reference.spectral import st
from strategies import rigid

pytestmark = pytest.mark.filterwarnings("error")


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
def test_otsu_of_constant_scores(mode: Any) -> None:
    for value in (0.3, 1e-7, 0.0, -0.3):
        mask, threshold = otsu_split(value * np.array([1.0, 1.0 + 1e-12, 1.0 - 1e-12]), mode)
        assert threshold is None
        assert (mask == (value > 0)).all()
    assert otsu_split(np.zeros(0), mode)[0].shape == (0,)


TRIANGLE = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 4.0, 0.0]])


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
    assert gc(source, target, tolerance=0.5).mask.tolist() == [True, True, False, False]
    assert gc(source, target, tolerance=0.5, ties="union").mask.all()


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
