"""Generated pairs and matches: the scanner in software, stand-ins for data sets, and matching problems.

The generator of matching problems draws what it says; `matching_problems.rs` asserts the same of Rust's.
"""

import functools

import numpy as np
import pytest
from pair_measures import matching, residual, share_right
from scipy.spatial.distance import pdist

from cgroup import InputError
from cgroup.datasets import make_problem, open_dataset, standin_pair
from cgroup.datasets.generated import stones
from cgroup.datasets.generated.scanner import Mesh, range_image
from cgroup.datasets.generated_matches import FRAMES, SCENES, make_scene
from cgroup.evaluation.ground_truth import triangle_areas
from cgroup.features.cloud import within
from cgroup.rigid import check_rigid


def draw(**options):
    return make_problem(np.random.default_rng(0), **{"n": 10, **options})


def test_the_seed_decides():
    pairs = [standin_pair(seed=seed, pixels=SMALL) for seed in (3, 3, 4)]
    problems = [make_problem(np.random.default_rng(seed), 50) for seed in (3, 3, 4)]
    for first, second, other in (
        [(pair.source.points, pair.target.points, pair.T_target_source) for pair in pairs],
        [(problem.source, problem.ratio, problem.T_target_source) for problem in problems],
    ):
        assert all(map(np.array_equal, first, second))
        assert not any(map(np.array_equal, first, other))


@pytest.mark.parametrize(
    ("make", "name", "value"),
    [
        *(
            (standin_pair, *wrong)
            for wrong in (("turn", -1), ("turn", np.nan), ("noise", np.inf), ("pixels", 3))
        ),
        *((draw, *wrong) for wrong in (("n", -1), ("inlier_ratio", 1.1), ("missing_frames", np.nan))),
    ],
)
def test_bad_arguments_are_refused(make, name, value):
    with pytest.raises(InputError, match=name):
        make(**{name: value})


# --- scanner ------------------------------------------------------------------------------------


SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
look = functools.partial(range_image, step=0.013, offset=np.array([1.0, 1.0]))


def test_scanner_sees_a_wall_behind_a_smaller_one() -> None:
    vertices = np.concatenate([SQUARE - [0, 0, 4], 4 * SQUARE - [0, 0, 8]])
    near, far = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[4, 5, 6], [4, 6, 7]])
    image = look(Mesh(vertices, np.concatenate([near, far])))
    points = image.points()
    front = np.abs(points[:, 2] + 4) < 1e-9
    np.testing.assert_allclose(points[~front, 2], -8)
    assert (np.abs(points[front, :2]) <= 1).all()
    shadow = np.abs(points[~front, :2]).max(axis=1)
    assert shadow.min() > 2 - 1e-9  # what the near wall hides of the far one
    # No triangle spans the step between them, and together they have the area of what is seen.
    corners = points[image.faces()]
    assert (np.ptp(corners[:, :, 2], axis=1) < 1e-9).all()
    area = triangle_areas(points, image.faces()).sum()
    assert area == pytest.approx(4 + 64 - 16, rel=0.1)  # a pixel less along each edge
    behind = look(Mesh(vertices, near[:, ::-1]))
    assert len(behind.points()) == 0
    both = look(Mesh(vertices, near[:, ::-1]), two_sided=True)
    assert len(both.points()) == front.sum()


def test_oblique_surfaces_return_nothing() -> None:
    tilt = np.radians(80)
    turned = SQUARE @ np.array([[1, 0, 0], [0, np.cos(tilt), np.sin(tilt)], [0, -np.sin(tilt), np.cos(tilt)]])
    mesh = Mesh(turned - [0, 0, 50], np.array([[0, 1, 2], [0, 2, 3]]))
    assert len(look(mesh, step=1e-3, two_sided=True).points()) == 0


# --- the pair of the demonstration --------------------------------------------------------------


SMALL = 60  # pixels


def spacing(points: np.ndarray) -> float:
    """Median distance of neighbouring pixels along the first axis of the grid."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return float(np.median(steps))


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_pose_lays_the_views_on_each_other(seed: int) -> None:
    pair = standin_pair(seed=seed, noise=0, pixels=SMALL)
    pose = check_rigid(pair.T_target_source)
    moved = pair.source.transformed(pose).points
    step = spacing(pair.target.points)
    near = within(moved, pair.target.points, 1.5 * step)
    assert 0.4 < near.mean() < 0.95
    wrong = pose.copy()
    wrong[:3, 3] += 4 * step
    assert within(pair.source.transformed(wrong).points, pair.target.points, step).mean() < 0.5 * near.mean()


def test_noise_is_along_the_line_of_sight() -> None:
    clean, noisy = (standin_pair(noise=noise, pixels=SMALL).source.points for noise in (0, 0.5))
    assert len(clean) == len(noisy)
    directions = clean / np.linalg.norm(clean, axis=1, keepdims=True)
    np.testing.assert_allclose(np.cross(noisy, directions), 0, atol=1e-9)
    deviation = np.linalg.norm(noisy - clean, axis=1).std()
    assert 0 < deviation < spacing(clean)


# --- data sets of stones ------------------------------------------------------------------------


@functools.cache
def standin(name, pair_name):
    return matching(open_dataset(name), pair_name)


@pytest.mark.parametrize(
    ("name", "count", "pair_name"),
    [
        ("standin-full", 6, "stone2"),
        ("standin-clutter", 12, "scene2-stone1"),
        ("standin-views", 12, "views5"),
    ],
)
def test_standins_are_reproducible_and_posed(name: str, count: int, pair_name: str) -> None:
    dataset = open_dataset(name)
    names = dataset.pair_names()
    assert len(names) == len(set(names)) == count
    first = standin(name, pair_name)
    stones._scene.cache_clear()
    again = matching(dataset, pair_name)
    np.testing.assert_array_equal(first.source.points, again.source.points)
    np.testing.assert_array_equal(first.target.points, again.target.points)
    assert first.facts == again.facts
    assert residual(first) < 1
    assert dataset.origin_of(pair_name) == "synthetic"
    with pytest.raises(InputError, match=rf"no pair 'x'.*{count}"):
        dataset.load("x")


# --- data set of matches ------------------------------------------------------------------------


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("frames", FRAMES)
def test_generated_matches_are_what_their_names_say(scene: str, frames: str) -> None:
    dataset = open_dataset("generated-matches")
    name = f"{scene}/n900/inliers0.2/noise1/{frames}-frames/3"
    pair, again = dataset.load(name), dataset.load(name)
    matches = pair.correspondences
    np.testing.assert_array_equal(matches.target, again.correspondences.target)
    assert len(matches) == 900
    assert share_right(matches, pair.T_target_source) == pytest.approx(0.2, abs=0.03)
    assert (matches.source_lrf is None) == (frames == "none")
    repeats = len(matches) / len(np.unique(matches.source, axis=0))
    assert repeats == (3 if scene == "one-to-three" else 1)


@pytest.mark.parametrize("scene", ["second-pose", "mirror"])
def test_rivals_keep_distances_among_themselves(scene: str) -> None:
    problem = make_scene(np.random.default_rng(1), 1000, inliers=0.3, noise=0, scene=scene, frames="good")
    rivals = np.flatnonzero(~problem.inlier_mask)
    source, target = pdist(problem.source[rivals]), pdist(problem.target[rivals])
    # 240 of the 700 wrong ones follow the rival.
    agree = np.abs(source - target) < 1e-6
    assert agree.mean() == pytest.approx((240 / 700) ** 2, rel=0.05)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("planes/n10", "names are like"),
        ("hills/n10/inliers0.2/noise1/good-frames/0", "names are like"),
        ("one-to-three/n90/inliers0.5/noise1/good-frames/0", "at most a third"),
    ],
)
def test_generated_matches_refuse_other_names(name: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        open_dataset("generated-matches").load(name)


# --- matching problems --------------------------------------------------------------------------


PLAIN = {"repeated_targets": 0.0, "random_frames": 0.0, "frame_error": 0.0}
SURFACE_RADIUS = 102.61  # mean distance of the surface's points from the origin


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
