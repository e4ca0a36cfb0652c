"""Pipelines that register whole clouds; libraries that may not be installed are replaced by fakes."""

import sys
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from cgroup.benchmark.pipelines import Clouds, own
from cgroup.benchmark.solver import make_solver
from cgroup.datasets import standin_pair
from cgroup.errors import NoConsensusError
from cgroup.evaluation import rotation_error, translation_error
from cgroup.features import choose_voxel

POSE = np.array([[0, -1, 0, 4], [1, 0, 0, 5], [0, 0, 1, 6], [0, 0, 0, 1]], dtype=float)


@pytest.fixture(scope="module")
def problem() -> Clouds:
    pair = standin_pair(pixels=100)
    source, target = pair.source.points, pair.target.points
    return Clouds(source, target, (0, 0, 0), (0, 0, 0), choose_voxel(source, target), threads=1)


@pytest.fixture
def pair() -> Clouds:
    points = np.random.default_rng(0).uniform(size=(20, 3))
    return Clouds(points, points + 1, None, None, voxel=2.0, threads=2, seed=7)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("cgroup", {}),
        ("cgroup", {"viewpoints": False}),
        ("cgroup-paper", {}),
        ("cgroup-matches", {"method": "lc"}),
        ("cgroup-matches", {"method": "ransac", "iterations": 20_000}),
        ("cgroup-matches", {"front": "paper", "method": "gtm"}),
    ],
)
def test_our_own_find_the_pose(problem, name, options):
    truth = standin_pair(pixels=100).T_target_source
    answer, seconds = make_solver("pipeline", "", name, options).register(problem)
    assert answer.ok
    assert answer.T_target_source is not None
    assert rotation_error(answer.T_target_source, truth) < 3
    assert translation_error(answer.T_target_source, truth) < 2 * problem.voxel
    assert all(value >= 0 for value in seconds.values())
    assert len(seconds) >= 2


@pytest.mark.parametrize("told", [True, False])
def test_viewpoints_are_told_or_not(problem, monkeypatch, told):
    register = Mock(
        return_value=SimpleNamespace(
            T_target_source=POSE, ok=True, probability=0.9, covariance=None, decoy_probability=None
        )
    )
    monkeypatch.setattr(own, "register", register)
    answer, _ = make_solver("pipeline", "", "cgroup", {"viewpoints": told, "effort": "low"}).register(problem)
    assert answer.T_target_source is POSE
    assert answer.probability == 0.9
    assert np.isnan(answer.decoy)
    given = register.call_args.kwargs
    assert (given["voxel"], given["effort"]) == (problem.voxel, "low")
    assert ("source_viewpoint" in given) == ("target_viewpoint" in given) == told


def test_the_best_guess_of_a_refusal_is_an_answer(problem, monkeypatch):
    refusal = NoConsensusError("nothing fits")
    monkeypatch.setattr(own, "register", Mock(side_effect=refusal))
    for guess in (POSE, None):
        found = SimpleNamespace(
            T_target_source=POSE, ok=False, probability=0.1, covariance=None, decoy_probability=0.05
        )
        refusal.registration = None if guess is None else found  # pyright: ignore[reportAttributeAccessIssue]
        answer, _ = make_solver("pipeline", "", "cgroup", {}).register(problem)
        assert answer.T_target_source is guess
        assert not answer.ok
        assert np.isnan(answer.decoy) if guess is None else answer.decoy == 0.05


def test_matches_that_fix_no_pose_are_no_answer(problem, monkeypatch):
    monkeypatch.setattr(own, "group", Mock(side_effect=NoConsensusError))
    answer, _ = make_solver("pipeline", "", "cgroup-matches", {}).register(problem)
    assert answer.T_target_source is None
    assert not answer.ok


@pytest.mark.parametrize(("inliers", "valid", "ok"), [(4, True, False), (5, True, True), (5, False, False)])
def test_kiss_matcher_works_at_its_own_scale(pair, monkeypatch, inliers, valid, ok):
    library = Mock()
    monkeypatch.setitem(sys.modules, "kiss_matcher", library)
    matcher = library.KISSMatcher.return_value
    matcher.estimate.return_value = SimpleNamespace(
        rotation=POSE[:3, :3], translation=POSE[:3, 3:] * 0.15, valid=valid
    )
    matcher.get_num_final_inliers.return_value = inliers
    answer, seconds = make_solver("pipeline", "", "kiss-matcher", {}).register(pair)
    library.KISSMatcherConfig.assert_called_once_with(0.3)
    library.KISSMatcher.assert_called_once_with(library.KISSMatcherConfig.return_value)
    np.testing.assert_allclose(matcher.estimate.call_args.args, [pair.source * 0.15, pair.target * 0.15])
    assert answer.ok == ok
    assert list(seconds) == ["pose"]
    if valid:
        np.testing.assert_allclose(answer.T_target_source, POSE)
    else:
        assert answer.T_target_source is None


def test_refinement_starts_from_the_pose_at_its_own_scale(pair, monkeypatch):
    def align(
        target: np.ndarray, source: np.ndarray, init_T_target_source: np.ndarray, num_threads: int
    ) -> SimpleNamespace:
        np.testing.assert_allclose(target, pair.target * 0.15)
        np.testing.assert_allclose(source, pair.source * 0.15)
        np.testing.assert_allclose(init_T_target_source[:3, 3], (0.15, 0.3, 0.45))
        assert num_threads == 2
        moved = init_T_target_source.copy()
        moved[0, 3] += 0.15
        return SimpleNamespace(T_target_source=moved)

    monkeypatch.setitem(sys.modules, "small_gicp", SimpleNamespace(align=align))  # pyright: ignore[reportArgumentType]
    refined = make_solver("pipeline", "", "benchmark_fakes:shifting", {}, refined=True)
    answer, seconds = refined.register(pair)
    assert answer.T_target_source is not None
    np.testing.assert_allclose(answer.T_target_source[:3, 3], (2, 2, 3))
    assert list(seconds)[-1] == "refinement"
    assert (
        make_solver("pipeline", "", "benchmark_fakes:poseless", {}, refined=True)
        .register(pair)[0]
        .T_target_source
        is None
    )
    assert refined.key != make_solver("pipeline", "", "benchmark_fakes:shifting", {}).key


@pytest.fixture
def open3d(monkeypatch: pytest.MonkeyPatch) -> Mock:
    """Finds `POSE`; clouds remember what is done to them, and stay what they are when they are thinned."""
    library = Mock()
    monkeypatch.setitem(sys.modules, "open3d", library)

    def make_cloud(_points: object) -> Mock:
        cloud = Mock()
        cloud.voxel_down_sample.return_value = cloud
        return cloud

    library.geometry.PointCloud = make_cloud
    library.geometry.KDTreeSearchParamHybrid = lambda radius, max_nn: (radius, max_nn)
    found = SimpleNamespace(fitness=0.5, transformation=POSE)
    for name in ("ransac", "fgr"):
        run = getattr(library.pipelines.registration, f"registration_{name}_based_on_feature_matching")
        run.return_value = found
    return library


def test_open3d_is_told_viewpoints_and_may_find_nothing(pair, open3d):
    run = open3d.pipelines.registration.registration_ransac_based_on_feature_matching
    run.return_value.fitness = 0.0
    known = Clouds(pair.source, pair.target, (1, 2, 3), None, voxel=2.0)
    answer, _ = make_solver("pipeline", "", "open3d-ransac", {}).register(known)
    assert answer.T_target_source is None
    assert not answer.ok
    source, target = run.call_args.args[:2]
    source.orient_normals_towards_camera_location.assert_called_once_with((1, 2, 3))
    target.orient_normals_towards_camera_location.assert_not_called()
