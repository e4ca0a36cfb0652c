"""Criteria against cases worked out by hand, and against brute force."""

import math

import numpy as np
import pytest

from cgroup.errors import InputError
from cgroup.evaluation import (
    PROTOCOLS,
    GroupScore,
    clutter_and_occlusion,
    correct_matches,
    overlap,
    score_group,
    translation_error,
)
from cgroup.evaluation.metrics import score_counts
from cgroup.features import within
from strategies import rigid


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def test_scores_of_a_group() -> None:
    correct = np.array([1, 1, 1, 1, 0, 0, 0, 0, 0, 0], dtype=bool)
    mask = np.array([1, 1, 0, 0, 1, 0, 0, 0, 0, 0], dtype=bool)
    score = score_group(mask, correct)
    assert score == GroupScore(matches=10, correct=4, selected=3, selected_correct=2)
    assert score.precision == pytest.approx(2 / 3)
    assert score.recall == 0.5
    assert score.f_score == pytest.approx(2 * (2 / 3) * 0.5 / (2 / 3 + 0.5))
    assert score.inlier_ratio == 0.4
    assert score.registered


def test_undefined_scores_are_zero_and_registered_is_strict() -> None:
    for counts in ((0, 0, 0, 0), (5, 2, 0, 0), (5, 0, 3, 0), (5, 2, 2, 0)):
        score = GroupScore(*counts)
        assert (score.precision, score.recall, score.f_score, score.registered) == (0, 0, 0, False)
    assert not GroupScore(100, 50, 10, 1).registered
    assert GroupScore(100, 50, 10, 2).registered


def test_many_groups_are_scored_as_each_alone() -> None:
    counts = [(10, 4, 4, 2), (10, 4, 0, 0), (10, 0, 5, 0), (0, 0, 0, 0)]
    groups = [GroupScore(*each) for each in counts]
    scores = score_counts(*np.array(counts).T)
    for name in ("inlier_ratio", "precision", "recall", "f_score", "registered"):
        assert getattr(scores, name).tolist() == [getattr(group, name) for group in groups]
    unknown = score_counts(*np.full((4, 1), np.nan))
    assert np.isnan([unknown.inlier_ratio, unknown.precision, unknown.recall, unknown.f_score]).all()
    assert unknown.registered.tolist() == [False]


def test_correct_includes_the_limit() -> None:
    source = np.zeros((4, 3))
    target = np.array([[10.0, 0, 0], [10, 5, 0], [10, 0, 5.0001], [0, 0, 0]])
    correct = correct_matches(source, target, rigid((0, 0, 1), 90, (10, 0, 0)), tolerance=5)
    assert correct.tolist() == [True, True, False, False]


@pytest.mark.parametrize(
    ("source", "tolerance", "words"),
    [
        (np.zeros((2, 3)), 1, "`source` has 2"),
        (np.eye(3), 0, "tolerance"),
        (np.eye(3), math.nan, "tolerance"),
    ],
)
def test_correct_rejects_what_does_not_fit(source, tolerance, words) -> None:
    with pytest.raises(InputError, match=words):
        correct_matches(source, np.eye(3), np.eye(4), tolerance=tolerance)


def test_translation_error() -> None:
    assert translation_error(rigid((1, 0, 0), 30, (1, 2, 3)), rigid((0, 1, 0), 9, (1, 5, 7))) == 5


@pytest.mark.parametrize("unit", [1.0, 0.1, 1e-3])
@pytest.mark.parametrize("offset", [0.0, 1e3, -1e6])
def test_within_includes_its_radius(unit: float, offset: float, rng: np.random.Generator) -> None:
    # On a lattice many distances are the radius itself, up to rounding: the same rounding as NumPy's.
    points, others = (rng.integers(0, 9, size=(200, 3)) * unit + offset for _ in range(2))
    distances = np.linalg.norm(points[:, None] - others[:20], axis=2).min(axis=1)
    for radius in unit * np.sqrt([1, 2, 3, 4, 5, 9]):
        np.testing.assert_array_equal(within(points, others[:20], radius), distances <= radius)
    assert not within(points, np.empty((0, 3)), unit).any()


def test_overlap_of_two_halves(rng: np.random.Generator) -> None:
    cloud = rng.uniform(size=(1000, 3)) * (10, 1, 1)
    left, right = cloud[cloud[:, 0] < 6], cloud[cloud[:, 0] > 4]
    motion = rigid((1, 1, 0), 40, (3, 2, 1))
    moved = left @ motion[:3, :3].T + motion[:3, 3]
    common = ((cloud[:, 0] > 4) & (cloud[:, 0] < 6)).sum()
    share = overlap(moved, right, np.linalg.inv(motion), tolerance=1e-6)
    assert share == pytest.approx(common / min(len(left), len(right)))
    assert overlap(right, moved, motion, tolerance=1e-6) == share
    with pytest.raises(InputError, match="no points"):
        overlap(left, np.empty((0, 3)), motion, tolerance=1)


def test_clutter_and_occlusion() -> None:
    """Of a model of two unit squares; the scene shows one of them and three other squares."""

    def strip(squares: int) -> tuple[np.ndarray, np.ndarray]:
        x = np.arange(squares + 1.0)
        vertices = np.concatenate([np.c_[x, x * 0, x * 0], np.c_[x, x * 0 + 1, x * 0]])
        i, up = np.arange(squares), squares + 1
        return vertices, np.concatenate([np.c_[i, i + 1, i + up], np.c_[i + 1, i + 1 + up, i + up]])

    model, model_faces = strip(2)
    scene, scene_faces = strip(4)
    away = rigid((0, 0, 1), 0, (3, 0, 0))  # the model covers the scene's last square only
    clutter, occlusion = clutter_and_occlusion(model, model_faces, scene, scene_faces, away, tolerance=0.01)
    assert (clutter, occlusion) == (pytest.approx(0.75), pytest.approx(0.5))


NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("name", "errors", "verdict"),
    [
        ("precision>0.1", (0.1, NAN, NAN, NAN), False),
        ("precision>0.1", (0.1000001, INF, INF, INF), True),
        ("precision>0.1", (0.0, 0, 0, 0), False),
        ("rmse<=1pr", (0.0, NAN, NAN, 1.0), True),
        ("rmse<=1pr", (1.0, 0, 0, 1.01), False),
        ("rmse<=5pr", (0.0, 90, 90, 5.0), True),
        ("3dmatch", (0.0, 15.0, 0.3, NAN), True),
        ("3dmatch", (0.0, 15.1, 0.1, NAN), False),
        ("3dmatch", (0.0, 1.0, 0.31, NAN), False),
        ("kitti", (0.0, 5.0, 0.6, NAN), True),
        ("kitti", (0.0, 5.0, 0.61, NAN), False),
        ("kitti-2m", (0.0, 5.0, 2.0, NAN), True),
        ("kitti-2m", (0.0, 5.1, 0.1, NAN), False),
    ],
)
def test_limits_of_protocols(name: str, errors: tuple[float, ...], verdict: bool) -> None:
    assert PROTOCOLS[name].judge(*errors) is verdict


def test_what_is_unknown_or_half_known_is_no_verdict() -> None:
    for name, protocol in PROTOCOLS.items():
        assert protocol.name == name
        assert protocol.judge(NAN, NAN, NAN, NAN) is None
    assert PROTOCOLS["3dmatch"].judge(1.0, 3.0, NAN, NAN) is None
