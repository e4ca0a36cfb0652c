"""Matches without a unit: likelihood consensus finds the pose, and estimates what other methods need."""

from dataclasses import replace

import numpy as np
import pytest
from shared_data import data_folder

import cgroup
from cgroup import Correspondences, InputError
from cgroup.datasets import make_problem, open_dataset
from cgroup.evaluation import rotation_error
from cgroup.rigid import apply


def drawn(noise: float, scale: float = 1.0, seed: int = 3) -> tuple[Correspondences, np.ndarray, np.ndarray]:
    problem = make_problem(np.random.default_rng(seed), 1000, inlier_ratio=0.1, noise=noise)
    pose = problem.T_target_source.copy()
    pose[:3, 3] *= scale
    return Correspondences(scale * problem.source, scale * problem.target), pose, problem.inlier_mask


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e5])
def test_the_unit_makes_no_difference(scale: float) -> None:
    matches, pose, right = drawn(1.0, scale)
    found = cgroup.group(matches)
    assert found.ok
    assert rotation_error(found.model, pose) < 1
    assert found.mask[right].mean() > 0.9
    assert found.mask[~right].mean() < 0.02
    assert found.noise is not None
    assert 0.5 * scale < found.noise < 4 * scale
    assert found.diagnostics["dimensions"] == 3


def test_a_resolution_too_small_for_the_noise_is_not_believed() -> None:
    matches, pose, right = drawn(1.5)
    found = cgroup.group(replace(matches, resolution=0.25))
    assert found.ok
    assert rotation_error(found.model, pose) < 1
    assert found.mask[right].mean() > 0.8
    assert found.mask[~right].mean() < 0.02
    assert found.diagnostics["resolution"] > 0.5


def test_many_right_matches_do_not_hide_the_noise() -> None:
    problem = make_problem(np.random.default_rng(1), 20_000, inlier_ratio=0.5, noise=1.5)
    found = cgroup.lc(problem.source, problem.target)
    assert found.noise is not None
    assert 1.0 < found.noise < 3.0
    assert found.mask[problem.inlier_mask].mean() > 0.8


def test_auto_gives_other_methods_a_resolution() -> None:
    matches, _, right = drawn(1.0)
    for method in ("ransac", "sc2pcr", "mac", "gc"):
        found = cgroup.group(matches, method, tolerance="auto")
        assert found.mask[right].mean() > 0.8
        assert found.rule.resolution is not None
    with pytest.raises(InputError, match="auto"):
        cgroup.group(matches, "sc2pcr")
    with pytest.raises(InputError, match="tolerance"):
        cgroup.group(matches, "ransac", tolerance="automatic")


def test_auto_of_lc_means_no_tolerance() -> None:
    given, *_ = drawn(1.0)
    for matches in (given, replace(given, resolution=7.0)):
        auto, unset = (cgroup.group(matches, **asked) for asked in ({"tolerance": "auto"}, {}))
        assert auto.diagnostics == unset.diagnostics
        assert auto.false_alarms == unset.false_alarms
        assert (auto.mask == unset.mask).all()


def test_matches_of_others_need_no_unit() -> None:
    for name in ("corr", "corr-three"):
        dataset = open_dataset(name, data_folder("corr"))
        for pair in map(dataset.load, dataset.pair_names()):
            given = pair.correspondences
            for resolution in (None, 0.25 * given.resolution):
                found = cgroup.lc(given.source, given.target, resolution=resolution)
                near = [
                    np.linalg.norm(apply(pose, given.source) - given.target, axis=1) < 5 * given.resolution
                    for pose in (found.model, pair.T_target_source)
                ]
                f = 2 * (near[0] & near[1]).sum() / (near[0].sum() + near[1].sum())
                assert found.ok, (pair.name, resolution)
                assert f > 0.65, (pair.name, resolution)
