"""Noise, decimation, and what takes away from the shape in common."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from cgroup import features
from cgroup.datasets import MatchingPair, standin_pair
from cgroup.datasets.base import mean_resolution
from cgroup.datasets.generated.stones import stone
from cgroup.errors import InputError
from cgroup.evaluation import overlap
from cgroup.evaluation.ground_truth import OVERLAP_WITHIN
from cgroup.features import within
from cgroup.io import PointCloud
from cgroup.nuisances import NUISANCES, add_noise, apply_nuisance, decimate

POSE = np.array([[0.0, -1, 0, 30], [1, 0, 0, -20], [0, 0, 1, 200], [0, 0, 0, 1]])


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.fixture(scope="module")
def pair() -> MatchingPair:
    mesh = stone(np.random.default_rng(0), 30)
    model = PointCloud(mesh.vertices, faces=mesh.faces)
    return MatchingPair("whole", model, model.transformed(POSE), POSE, facts={"noise": 0.0, "kept": 1.0})


def test_noise_has_the_size_asked_for(rng: np.random.Generator, pair: MatchingPair) -> None:
    noisy = add_noise(pair.target, 0.5, rng)
    moved = noisy.points - pair.target.points
    np.testing.assert_allclose(moved.std(axis=0), 0.5, rtol=0.05)
    np.testing.assert_allclose(moved.mean(axis=0), 0, atol=0.05)
    assert noisy.faces is pair.target.faces
    np.testing.assert_array_equal(add_noise(pair.target, 0, rng).points, pair.target.points)


def test_random_decimation_keeps_points_in_order(rng: np.random.Generator) -> None:
    points = np.arange(3000.0).reshape(-1, 3)
    colors = np.zeros((1000, 3), dtype=np.uint8)
    cloud = PointCloud(points, normals=-points, faces=np.array([[0, 1, 2]]), colors=colors)
    thin = decimate(cloud, 0.3, rng)
    assert (np.diff(thin.points[:, 0]) > 0).all()
    np.testing.assert_array_equal(thin.normals, -thin.points)
    assert thin.faces is None
    assert len(thin) == len(thin.colors) == 300


def test_voxel_decimation_comes_near_the_share(rng: np.random.Generator, pair: MatchingPair) -> None:
    for share in (0.1, 0.5, 0.9):
        thin = decimate(pair.target, share, rng, method="voxel")
        assert len(thin) == pytest.approx(share * len(pair.target), rel=0.1)
    for method in ("random", "voxel"):
        whole = decimate(pair.target, 1.0, rng, method=method)
        np.testing.assert_array_equal(whole.points, pair.target.points)


@pytest.mark.parametrize(
    ("words", "call"),
    [
        *(("sigma", partial(add_noise, sigma=sigma)) for sigma in (-1.0, np.nan, np.inf)),
        *(("share: got .*give the part", partial(decimate, share=s)) for s in (0.0, -0.1, 1.1, np.nan)),
        ("leaves 5 points", partial(decimate, share=5 / 5400)),
        ("method", partial(decimate, share=0.5, method="grid")),
    ],
)
def test_bad_arguments(words: str, call: Any, rng: np.random.Generator, pair: MatchingPair) -> None:
    with pytest.raises(InputError, match=words):
        call(pair.target, rng=rng)


@pytest.mark.parametrize("name", NUISANCES)
def test_same_generator_same_pair_with_its_pose_and_other_facts(name: str, pair: MatchingPair) -> None:
    before = pair.target.points.copy()
    pairs = [apply_nuisance(name, pair, 0.7, np.random.default_rng(seed)) for seed in (1, 1, 2)]
    first, second, other = (harder.target.points for harder in pairs)
    np.testing.assert_array_equal(first, second)
    if name != "voxel-density":
        assert first.shape != other.shape or (first != other).any()
    for harder in pairs:
        assert harder.name == pair.name
        assert harder.T_target_source is pair.T_target_source
        assert harder.facts["kept"] == 1.0
    np.testing.assert_array_equal(pair.target.points, before)


def test_noise_of_a_pair_is_in_pr(rng: np.random.Generator, pair: MatchingPair) -> None:
    harder = apply_nuisance("noise", pair, 0.3, rng)
    deviation = (harder.target.points - pair.target.points).std()
    assert deviation == pytest.approx(0.3 * features.resolution(pair.target.points), rel=0.05)
    assert harder.facts["noise"] == 0.3
    assert harder.source is pair.source


@pytest.mark.parametrize("level", [0.3, 0.9])
def test_overlap_is_reached(level: float, rng: np.random.Generator, pair: MatchingPair) -> None:
    harder = apply_nuisance("overlap", pair, level, rng)
    reached = overlap(
        harder.source.points,
        harder.target.points,
        harder.T_target_source,
        tolerance=OVERLAP_WITHIN * mean_resolution(pair.source, pair.target),
    )
    assert reached == pytest.approx(level, abs=0.06)
    assert harder.facts["overlap"] == pytest.approx(reached)
    assert harder.source.faces.max() < len(harder.source)


def test_occlusion_is_reached(rng: np.random.Generator, pair: MatchingPair) -> None:
    for level in (0.6, 0.9):
        harder = apply_nuisance("occlusion", pair, level, rng)
        assert harder.facts["occlusion"] == pytest.approx(level, abs=0.05)
        assert harder.source is pair.source
        assert len(harder.target) == pytest.approx((1 - level) * len(pair.target), rel=0.2)


def test_clutter_is_reached_and_lies_apart(rng: np.random.Generator, pair: MatchingPair) -> None:
    level = 0.65
    harder = apply_nuisance("clutter", pair, level, rng)
    added = harder.target.points[len(pair.target) :]
    assert len(pair.target) / len(harder.target) == pytest.approx(1 - level, abs=0.01)
    assert harder.facts["clutter"] == pytest.approx(level, abs=0.01)
    assert not within(added, pair.target.points, 5 * mean_resolution(pair.source, pair.target)).any()
    assert features.resolution(added) == pytest.approx(features.resolution(pair.target.points), rel=0.5)


@pytest.mark.parametrize("name", ["overlap", "occlusion", "clutter"])
def test_shares_are_checked(name: str, rng: np.random.Generator, pair: MatchingPair) -> None:
    for level in (0.0, 1.0, float("nan")):
        with pytest.raises(InputError, match=name):
            apply_nuisance(name, pair, level, rng)


def test_more_overlap_and_less_clutter_and_occlusion_than_there_are(
    rng: np.random.Generator, pair: MatchingPair
) -> None:
    with pytest.raises(InputError, match="overlaps by only"):
        apply_nuisance("overlap", standin_pair(turn=60, pixels=60), 0.95, rng)
    for name in ("clutter", "occlusion"):
        harder = apply_nuisance(name, pair, 0.8, rng)
        with pytest.raises(InputError, match="already"):
            apply_nuisance(name, harder, 0.7, rng)


def rename(pair: MatchingPair, level: float, _rng: np.random.Generator) -> MatchingPair:
    return replace(pair, name=f"{level}")


def test_nuisance_from_outside(rng: np.random.Generator, pair: MatchingPair) -> None:
    assert apply_nuisance(f"{__name__}:rename", pair, 0.5, rng).name == "0.5"
    for name, words in (("fog", "choose one of noise.*module:function"), ("sys:missing", "has no 'missing'")):
        with pytest.raises(InputError, match=words):
            apply_nuisance(name, pair, 0.5, rng)
