"""Likelihood consensus where the scale between both sides is unknown."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as hst

import cgroup
from cgroup.datasets import MatchingProblem, make_problem
from cgroup.errors import InputError
from cgroup.evaluation import rotation_error
from cgroup.rigid import apply
from cgroup.rigid.transforms import split_scale
from cgroup.types import FloatArray

SHARES = {200: (0.1, 0.2), 1000: (0.025, 0.2), 2000: (0.02, 0.1)}
"""Least and greatest share of right matches by their number."""


def drawn(seed: int, n: int, share: float, noise: float = 1.0) -> MatchingProblem:
    return make_problem(np.random.default_rng(seed), n, inlier_ratio=share, noise=noise)


def misplacement(model: FloatArray | None, problem: MatchingProblem, unit: float) -> float:
    """Root mean square distance of the right matches' points from where they belong, in pr."""
    assert model is not None
    right = problem.source[problem.inlier_mask]
    offsets = apply(model, unit * right) - apply(problem.T_target_source, right)
    return float(np.sqrt((offsets**2).sum(axis=1).mean()))


@given(data=hst.data())
@settings(max_examples=10)
def test_similar_shapes_are_found(data: hst.DataObject) -> None:
    n = data.draw(hst.sampled_from(sorted(SHARES)), label="n")
    share = data.draw(hst.floats(*SHARES[n]), label="share")
    unit = data.draw(hst.floats(1 / 3, 3.0), label="unit")
    problem = drawn(data.draw(hst.integers(0, 10**6), label="seed"), n, share)
    resolution = data.draw(hst.sampled_from([None, problem.resolution]), label="resolution")
    found = cgroup.lc(unit * problem.source, problem.target, resolution=resolution, scale=True)
    assert found.ok
    assert found.model is not None
    scale, pose = split_scale(found.model)
    assert found.diagnostics["scale"] == pytest.approx(scale)
    assert abs(scale * unit - 1) < 0.01
    assert rotation_error(pose, problem.T_target_source) < 2
    assert misplacement(found.model, problem, unit) < 1.5
    assert found.mask[problem.inlier_mask].mean() > 0.8


@given(seed=hst.integers(0, 10**6), kind=hst.sampled_from(["points", "partners"]))
@settings(max_examples=10)
def test_nothing_in_common_is_not_sure(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(30, 400))
    if kind == "points":
        source, target = rng.normal(size=(2, n, 3))
    else:
        problem = drawn(seed, n, 0.5)
        source, target = problem.source, problem.target[rng.permutation(n)]
    found = cgroup.lc(source, target, scale=True)
    assert not found.ok
    assert found.false_alarms is not None
    assert found.false_alarms > 1


@pytest.mark.parametrize("factor", [1e-6, 0.7, 1e5])
def test_the_unit_of_the_source_makes_no_difference(factor: float) -> None:
    problem = drawn(4, 500, 0.1)
    one, other = (
        cgroup.lc(unit * problem.source, problem.target, scale=True, instances=2) for unit in (1.0, factor)
    )
    assert np.array_equal(one.mask, other.mask)
    assert one.false_alarms == pytest.approx(other.false_alarms)
    assert one.diagnostics["scale"] == pytest.approx(factor * other.diagnostics["scale"])
    point = problem.source[0]
    placed = one.alternatives @ [*point, 1]
    np.testing.assert_allclose(other.alternatives @ [*factor * point, 1], placed, atol=1e-6)
    assert np.array_equal(one.instances, other.instances)


def test_bounds_are_kept() -> None:
    problem = drawn(6, 500, 0.2)
    inside = cgroup.lc(2 * problem.source, problem.target, scale=(0.4, 0.6))
    assert inside.ok
    assert inside.diagnostics["scale"] == pytest.approx(0.5, abs=0.005)
    outside = cgroup.lc(2 * problem.source, problem.target, scale=(0.6, 0.9))
    assert 0.6 <= outside.diagnostics["scale"] <= 0.9
    with pytest.raises(InputError, match="scale: got .* give bounds around that"):
        cgroup.lc(problem.source, problem.target, scale=(100.0, 200.0))
