"""Pipelines that register whole clouds; libraries that may not be installed are replaced by fakes."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cgroup.benchmark.pipelines import PIPELINES, Clouds, own
from cgroup.benchmark.solver import make_pipeline
from cgroup.datasets import standin_pair
from cgroup.errors import NoConsensusError
from cgroup.evaluation import rotation_error, translation_error
from cgroup.features import choose_voxel

POSE = np.array([[0, -1, 0, 4], [1, 0, 0, 5], [0, 0, 1, 6], [0, 0, 0, 1]], dtype=float)


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return standin_pair(pixels=100).T_target_source


@pytest.fixture(scope="module")
def problem() -> Clouds:
    pair = standin_pair(pixels=100)
    source, target = pair.source.points, pair.target.points
    return Clouds(source, target, (0, 0, 0), (0, 0, 0), choose_voxel(source, target), threads=1)


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
def test_our_own_find_the_pose(
    problem: Clouds, truth: np.ndarray, name: str, options: dict[str, Any]
) -> None:
    answer, seconds = make_pipeline("", name, options).register(problem)
    assert answer.ok
    assert answer.T_target_source is not None
    assert rotation_error(answer.T_target_source, truth) < 3
    assert translation_error(answer.T_target_source, truth) < 2 * problem.voxel
    assert all(value >= 0 for value in seconds.values())
    assert len(seconds) >= 2


@pytest.mark.parametrize("told", [True, False])
def test_viewpoints_are_told_or_not(problem: Clouds, monkeypatch: pytest.MonkeyPatch, told: bool) -> None:
    given: dict[str, Any] = {}

    def register(*_clouds: object, **options: object) -> SimpleNamespace:
        given.update(options)
        return SimpleNamespace(T_target_source=POSE, ok=True, probability=0.9)

    monkeypatch.setattr(own, "register", register)
    answer, _ = make_pipeline("", "cgroup", {"viewpoints": told, "effort": "low"}).register(problem)
    assert answer.T_target_source is POSE
    assert answer.probability == 0.9
    assert given["voxel"] == problem.voxel
    assert given["effort"] == "low"
    assert ("source_viewpoint" in given) == told
    assert ("target_viewpoint" in given) == told


def test_the_best_guess_of_a_refusal_is_an_answer(problem: Clouds, monkeypatch: pytest.MonkeyPatch) -> None:
    refusal = NoConsensusError("nothing fits")
    refusal.registration = SimpleNamespace(T_target_source=POSE, ok=False, probability=0.1)  # pyright: ignore[reportAttributeAccessIssue]

    def register(*_clouds: object, **_options: object) -> None:
        raise refusal

    monkeypatch.setattr(own, "register", register)
    answer, _ = make_pipeline("", "cgroup", {}).register(problem)
    assert answer.T_target_source is POSE
    assert not answer.ok
    refusal.registration = None
    answer, _ = make_pipeline("", "cgroup", {}).register(problem)
    assert answer.T_target_source is None
    assert not answer.ok


def test_matches_that_fix_no_pose_are_no_answer(problem: Clouds, monkeypatch: pytest.MonkeyPatch) -> None:
    def group(*_given: object, **_options: object) -> None:
        raise NoConsensusError

    monkeypatch.setattr(own, "group", group)
    answer, _ = make_pipeline("", "cgroup-matches", {}).register(problem)
    assert answer.T_target_source is None
    assert not answer.ok


# --- KISS-Matcher ---------------------------------------------------------------------------------


class _Kiss:
    """Answers `POSE`, in the unit of the clouds that it gets."""

    valid, inliers = True, 5
    seen: np.ndarray

    def __init__(self, config: float) -> None:
        self.voxel = config

    def estimate(self, source: np.ndarray, _target: np.ndarray) -> SimpleNamespace:
        type(self).seen = source
        translation = POSE[:3, 3:] * (self.voxel / 2.0)  # the problem's voxel is 2
        return SimpleNamespace(rotation=POSE[:3, :3], translation=translation, valid=self.valid)

    def get_num_final_inliers(self) -> int:
        return self.inliers

    def get_processing_time(self) -> float:
        return 0.0

    get_extraction_time = get_matching_time = get_processing_time


@pytest.fixture
def pair() -> Clouds:
    points = np.random.default_rng(0).uniform(size=(20, 3))
    return Clouds(points, points + 1, None, None, voxel=2.0, threads=2, seed=7)


@pytest.mark.parametrize(("inliers", "ok"), [(4, False), (5, True)])
def test_kiss_matcher_works_at_its_own_scale(
    pair: Clouds, monkeypatch: pytest.MonkeyPatch, inliers: int, ok: bool
) -> None:
    monkeypatch.setattr(_Kiss, "inliers", inliers)
    fake = SimpleNamespace(KISSMatcher=_Kiss, KISSMatcherConfig=lambda voxel: voxel)
    monkeypatch.setitem(sys.modules, "kiss_matcher", fake)  # pyright: ignore[reportArgumentType]
    answer, seconds = make_pipeline("", "kiss-matcher", {}).register(pair)
    np.testing.assert_allclose(_Kiss.seen, pair.source * 0.15)
    np.testing.assert_allclose(answer.T_target_source, POSE)
    assert answer.ok == ok
    assert list(seconds) == ["features", "matching", "pose"]
    monkeypatch.setattr(_Kiss, "valid", False)
    assert make_pipeline("", "kiss-matcher", {}).register(pair)[0].T_target_source is None


# --- small_gicp -----------------------------------------------------------------------------------


def test_refinement_starts_from_the_pose_at_its_own_scale(
    pair: Clouds, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    refined = make_pipeline("", "benchmark_fakes:shifting", {}, refined=True)
    answer, seconds = refined.register(pair)
    assert answer.T_target_source is not None
    np.testing.assert_allclose(answer.T_target_source[:3, 3], (2, 2, 3))
    assert list(seconds)[-1] == "refinement"
    assert (
        make_pipeline("", "benchmark_fakes:poseless", {}, refined=True).register(pair)[0].T_target_source
        is None
    )
    assert refined.key != make_pipeline("", "benchmark_fakes:shifting", {}).key


# --- Open3D ---------------------------------------------------------------------------------------


class _Cloud:
    """Remembers what is done to it."""

    def __init__(self, points: np.ndarray) -> None:
        self.points = points
        self.calls: list[object] = []

    def voxel_down_sample(self, voxel: float) -> _Cloud:
        self.calls.append(("voxels", voxel))
        return self

    def estimate_normals(self, search: object) -> None:
        self.calls.append(("normals", search))

    def orient_normals_towards_camera_location(self, viewpoint: object) -> None:
        self.calls.append(("towards", viewpoint))


def _fake_open3d(fitness: float, seen: dict[str, Any]) -> SimpleNamespace:
    def ransac(source: _Cloud, target: _Cloud, *rest: object) -> SimpleNamespace:
        seen.update(source=source, target=target, reach=rest[3], criteria=rest[-1])
        return SimpleNamespace(fitness=fitness, transformation=POSE)

    def fast(source: _Cloud, target: _Cloud, _one: object, _other: object, option: float) -> SimpleNamespace:
        seen.update(source=source, target=target, reach=option)
        return SimpleNamespace(fitness=fitness, transformation=POSE)

    registration = SimpleNamespace(
        compute_fpfh_feature=lambda _cloud, search: search,
        registration_ransac_based_on_feature_matching=ransac,
        registration_fgr_based_on_feature_matching=fast,
        TransformationEstimationPointToPoint=lambda with_scale: with_scale,
        CorrespondenceCheckerBasedOnEdgeLength=float,
        CorrespondenceCheckerBasedOnDistance=float,
        RANSACConvergenceCriteria=lambda iterations, confidence: (iterations, confidence),
        FastGlobalRegistrationOption=lambda maximum_correspondence_distance: maximum_correspondence_distance,
    )
    return SimpleNamespace(
        geometry=SimpleNamespace(
            PointCloud=_Cloud, KDTreeSearchParamHybrid=lambda radius, max_nn: (radius, max_nn)
        ),
        pipelines=SimpleNamespace(registration=registration),
        utility=SimpleNamespace(
            Vector3dVector=np.asarray,
            random=SimpleNamespace(seed=lambda seed: seen.update(seed=seed)),
            set_verbosity_level=lambda _level: None,
            VerbosityLevel=SimpleNamespace(Error=0),
        ),
    )


@pytest.mark.parametrize(("name", "reach"), [("open3d-ransac", 3.0), ("open3d-fgr", 1.0)])
def test_open3d_gets_the_parameters_of_its_tutorial(
    pair: Clouds, monkeypatch: pytest.MonkeyPatch, name: str, reach: float
) -> None:
    seen: dict[str, Any] = {}
    monkeypatch.setitem(sys.modules, "open3d", _fake_open3d(0.5, seen))  # pyright: ignore[reportArgumentType]
    answer, seconds = make_pipeline("", name, {}).register(pair)
    np.testing.assert_array_equal(answer.T_target_source, POSE)
    assert answer.ok
    assert seen["reach"] == reach
    assert seen["source"].calls == [("voxels", 2.0), ("normals", (4.0, 30))]
    assert list(seconds) == ["features", "pose"]
    if name == "open3d-ransac":
        assert seen["seed"] == 7
        assert seen["criteria"] == (100_000, 0.999)


def test_open3d_is_told_viewpoints_and_may_find_nothing(
    pair: Clouds, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, Any] = {}
    monkeypatch.setitem(sys.modules, "open3d", _fake_open3d(0.0, seen))  # pyright: ignore[reportArgumentType]
    known = Clouds(pair.source, pair.target, (1, 2, 3), None, voxel=2.0)
    answer, _ = make_pipeline("", "open3d-ransac", {}).register(known)
    assert answer.T_target_source is None
    assert not answer.ok
    assert ("towards", (1, 2, 3)) in seen["source"].calls
    assert len(seen["target"].calls) == 2


def test_labels_do_not_change_what_is_computed() -> None:
    one, other = (make_pipeline(label, "cgroup", {"effort": "low"}) for label in ("", "other"))
    assert one.key == other.key != make_pipeline("", "cgroup", {}).key
    assert (one.label, other.label) == ("cgroup", "other")
    assert one.why_missing() == ""
    assert all(info.title for info in PIPELINES.values())
