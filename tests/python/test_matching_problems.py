"""The generator of matching problems draws what it says; `matching_problems.rs` asserts the same of Rust's."""

import numpy as np
import pytest

from cgroup import InputError, group
from cgroup.datasets import make_problem

PLAIN = {"repeated_targets": 0.0, "random_frames": 0.0, "frame_error": 0.0}
SURFACE_RADIUS = 102.61  # mean distance of the surface's points from the origin


def test_same_state_same_problem():
    first, second, other = (make_problem(np.random.default_rng(seed), 50) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.source, second.source)
    np.testing.assert_array_equal(first.ratio, second.ratio)
    assert (first.source != other.source).all()


def test_means_of_the_distribution():
    drawn = make_problem(np.random.default_rng(1), 20_000, inlier_ratio=0.4, noise=0.5, **PLAIN)
    right = drawn.inlier_mask
    assert right.sum() == 8_000
    # A beta distribution's mean is a / (a + b).
    assert drawn.ratio[right].mean() == pytest.approx(4.0 / 5.8, abs=0.01)
    assert drawn.ratio[~right].mean() == pytest.approx(9.0 / 10.2, abs=0.01)
    assert drawn.similarity[right].mean() == pytest.approx(5.0 / 7.0, abs=0.01)
    assert drawn.similarity[~right].mean() == pytest.approx(4.0 / 7.0, abs=0.01)
    few = make_problem(np.random.default_rng(1), 20_000, inlier_ratio=0.05, noise=0.5, **PLAIN)
    assert few.ratio[few.inlier_mask].mean() == pytest.approx(6.0 / 7.4, abs=0.02)
    assert np.linalg.norm(drawn.source, axis=1).mean() == pytest.approx(SURFACE_RADIUS, abs=0.5)


def test_the_pose_explains_the_inliers_and_no_outlier():
    drawn = make_problem(np.random.default_rng(2), 20_000, inlier_ratio=0.4, noise=0.5, **PLAIN)
    rotation, shift = drawn.T_target_source[:3, :3], drawn.T_target_source[:3, 3]
    error = np.linalg.norm(drawn.source @ rotation.T + shift - drawn.target, axis=1)
    np.testing.assert_array_equal(error <= 4.9, drawn.inlier_mask)
    assert np.sqrt((error[drawn.inlier_mask] ** 2).mean() / 3) == pytest.approx(0.5, abs=0.01)
    moved = drawn.source_lrf @ rotation.T
    np.testing.assert_allclose(drawn.target_lrf[drawn.inlier_mask], moved[drawn.inlier_mask], atol=1e-12)


def test_nuisances_have_the_size_asked_for():
    drawn = make_problem(
        np.random.default_rng(3),
        5_000,
        inlier_ratio=0.2,
        repeated_targets=0.3,
        duplicated_sources=0.1,
        missing_frames=0.25,
        zero_descriptors=0.05,
        missing_second=0.15,
        radius=30.0,
        scale=0.01,
        offset=1e4,
    )
    repeated = 1 - len(np.unique(drawn.target, axis=0)) / len(drawn)
    # 0.3 of the 0.8 that are outliers; a quarter of these take what has been replaced itself.
    assert repeated == pytest.approx(0.3 * 0.8 * 0.8, abs=0.02)
    assert 1 - len(np.unique(drawn.source, axis=0)) / len(drawn) == pytest.approx(0.1, abs=0.02)
    no_frame = np.isnan(drawn.source_lrf[:, 0, 0]) | np.isnan(drawn.target_lrf[:, 0, 0])
    assert no_frame.mean() == pytest.approx(0.25, abs=0.03)
    assert np.isinf(drawn.similarity).mean() == pytest.approx(0.05, abs=0.01)
    assert (drawn.ratio == 1.0).mean() == pytest.approx(0.15, abs=0.02)
    assert np.linalg.norm(drawn.source_centroid) == pytest.approx(100.0)
    around = np.linalg.norm(drawn.source - drawn.source_centroid, axis=1).mean()
    assert around == pytest.approx(0.3 * 0.01 * SURFACE_RADIUS, rel=0.02)


def test_correspondences_are_what_a_method_takes():
    drawn = make_problem(np.random.default_rng(4), 200, inlier_ratio=0.5, noise=0.5)
    found = group(drawn.correspondences(), "gc").mask
    assert (found & drawn.inlier_mask).sum() > 0.8 * drawn.inlier_mask.sum()
    assert repr(drawn) == "MatchingProblem(n=200, inliers=100)"


@pytest.mark.parametrize(
    "options", [{"n": -1}, {"inlier_ratio": 1.1}, {"clutter": -0.1}, {"missing_frames": np.nan}]
)
def test_bad_arguments(options):
    arguments = {"n": 10, **options}
    with pytest.raises(InputError, match=next(iter(options))):
        make_problem(np.random.default_rng(0), **arguments)
