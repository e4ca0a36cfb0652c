"""Probabilities of matches, groups of several motions and certificates, against the NumPy reference."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as hst

import cgroup
from cgroup import Correspondences, Grouping
from cgroup.errors import InputError, NoConsensusError
from cgroup.rigid import apply
from reference import motions as reference
from reference.result import ReferenceGrouping
from strategies import BoolArray, FloatArray, Problem, make_problem, problems, random_motion

SEEDS = hst.integers(0, 10**6)
FEW = settings(max_examples=10)
NUDGES = (1.0, 1.0 + 1e-9, 1.0 - 1e-9)


def several(
    seed: int, sizes: list[int], wrong: int, noise: float = 0.5
) -> tuple[Correspondences, np.ndarray]:
    """Draw matches of bodies that move apart, in a random order, and the body of each: -1 for a wrong match."""
    rng = np.random.default_rng(seed)
    bodies = np.repeat(np.arange(-1, len(sizes)), [wrong, *sizes])
    source = rng.uniform(-75, 75, (1 + len(sizes), 3))[bodies + 1] + rng.uniform(-25, 25, (len(bodies), 3))
    target = rng.uniform(-100, 100, source.shape)
    for k in range(len(sizes)):
        rows = bodies == k
        target[rows] = apply(random_motion(rng, 50.0), source[rows]) + rng.normal(0, noise, (rows.sum(), 3))
    order = rng.permutation(len(bodies))
    return Correspondences(source[order], target[order], resolution=1.0), bodies[order]


def expected(matches: Correspondences, group: Grouping, factor: float) -> FloatArray:
    """The reference's probabilities, with a resolution that is changed by a factor."""
    unit = matches.resolution or group.diagnostics.get("resolution")
    unit = None if unit is None else factor * unit
    known = group.mask, group.model, group.alternatives, group.false_alarms
    return reference.match_probabilities(*points_of(matches), *known, resolution=unit)


def points_of(matches: Correspondences) -> tuple[FloatArray, FloatArray]:
    return matches.source.astype(np.float64), matches.target.astype(np.float64)


@given(
    problem=problems(max_size=100, nuisances=False),
    method=hst.sampled_from(["lc", "gtm", "ransac", "gc", "teaser"]),
    knows=hst.booleans(),
)
def test_probabilities_are_those_of_the_equations(problem: Problem, method: str, knows: bool) -> None:
    matches = problem.correspondences()
    group = cgroup.group(matches, method)
    matches = matches if knows else replace(matches, resolution=None)
    found = cgroup.match_probabilities(matches, group)
    assert ((found >= 0) & (found <= 1)).all()
    wanted, *others = (expected(matches, group, factor) for factor in NUDGES)
    assume(
        all(np.allclose(wanted, other, rtol=0, atol=1e-6) for other in others)
    )  # no radius decides by rounding
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-5)
    if knows:
        np.testing.assert_array_equal(group.probabilities, found)


@given(seed=SEEDS, unit=hst.sampled_from([0.3, 2.0]))
@FEW
def test_probabilities_under_a_similarity(seed: int, unit: float) -> None:
    problem = make_problem(np.random.default_rng(seed), 200, inlier_ratio=0.3)
    matches = Correspondences(unit * problem.source, problem.target, resolution=problem.resolution)
    found = cgroup.match_probabilities(matches, cgroup.group(matches, "lc", scale=True))
    assert found[problem.inlier_mask].mean() > 0.85
    assert found[~problem.inlier_mask].mean() < 0.05


@given(seed=SEEDS, method=hst.sampled_from(["lc", "gtm", "ransac", "sc2pcr"]))
def test_probabilities_without_anything_in_common_are_low(seed: int, method: str) -> None:
    rng = np.random.default_rng(seed)
    problem = make_problem(rng, int(rng.integers(0, 300)), inlier_ratio=0.5)
    matches = Correspondences(problem.source, rng.permutation(problem.target), resolution=problem.resolution)
    assert cgroup.match_probabilities(matches, cgroup.group(matches, method)).sum() < 2.0


def test_no_probabilities_without_a_pose() -> None:
    line = np.linspace(0, 1, 30)[:, None] * [1.0, 2.0, 3.0]
    for points in (line, np.ones((30, 3)), line[:2], line[:0]):
        matches = Correspondences(points, points)
        group = Grouping(np.ones(len(points), dtype=bool), None, None, None, {})
        np.testing.assert_array_equal(cgroup.match_probabilities(matches, group), np.zeros(len(points)))
    flat = np.random.default_rng(0).uniform(size=(60, 3)) * [50, 50, 0]
    assert cgroup.gtm(flat, flat + 1.0, resolution=1.0).probabilities.min() > 0.9
    with pytest.raises(InputError, match="one of 2 matches"):
        cgroup.match_probabilities(Correspondences(line, line), cgroup.gtm(line[:2], line[:2]))
    mirror = Grouping(np.ones(30, dtype=bool), None, None, np.diag([-1.0, 1, 1, 1]), {})
    with pytest.raises(InputError, match="no rigid motion"):
        cgroup.match_probabilities(Correspondences(line, line), mirror)


@given(seed=SEEDS, sizes=hst.lists(hst.integers(8, 25), min_size=1, max_size=3), wrong=hst.integers(0, 20))
@FEW
def test_motions_are_those_of_the_equations(seed: int, sizes: list[int], wrong: int) -> None:
    matches, _ = several(seed, sizes, wrong)
    found = cgroup.group_motions(matches)
    wanted, *others = (reference.group_motions(*points_of(matches), k) for k in NUDGES)
    assume(all(masks_of(other) == masks_of(wanted) for other in others))
    assert masks_of(found) == masks_of(wanted)
    for one, other in zip(found, wanted, strict=True):
        assert one.model is not None
        assert one.scores is not None
        assert other.alternatives is not None
        assert other.scores is not None
        np.testing.assert_allclose(one.model, other.alternatives[0], atol=1e-5)
        np.testing.assert_allclose(one.scores, other.scores, atol=1e-5)
        assert one.noise == pytest.approx(other.noise, rel=1e-6)
        assert one.false_alarms == pytest.approx(other.false_alarms, rel=1e-3)


def masks_of(groups: Sequence[Grouping | ReferenceGrouping]) -> list[list[int]]:
    return [np.flatnonzero(one.mask).tolist() for one in groups]


@given(seed=SEEDS, sizes=hst.lists(hst.integers(30, 60), max_size=6))
def test_every_motion_is_found_once(seed: int, sizes: list[int]) -> None:
    matches, bodies = several(seed, sizes, sum(sizes) or 50)
    found = cgroup.group_motions(matches)
    assert len(found) == len(sizes)
    assert np.sum([one.mask for one in found], axis=0).max(initial=0) <= 1
    for one in found:
        body = np.bincount(bodies[one.mask] + 1).argmax() - 1
        assert body >= 0
        assert f_score(one.mask, bodies == body) > 0.9
        assert one.ok
        assert one.false_alarms is not None
        assert one.false_alarms < 0.01


def f_score(mask: BoolArray, right: BoolArray) -> float:
    return 2 * (mask & right).sum() / (mask.sum() + right.sum())


def test_the_number_of_motions_is_bounded_and_their_order_is_that_of_discovery() -> None:
    matches, _ = several(1, [60, 30, 40], 50)
    assert cgroup.group_motions(matches, most=2)[0].size == 60
    assert len(cgroup.group_motions(matches, tolerance=3.0, most=1, threads=1)) == 1
    for wrong in (
        partial(cgroup.group_motions, matches, most=0),
        partial(cgroup.group_motions, matches, tolerance=-1),
    ):
        with pytest.raises(InputError):
            wrong()


@given(
    problem=problems(min_size=3, max_size=22, nuisances=False),
    tolerance=hst.sampled_from([1.0, 3.0, 10.0, 40.0]),
    method=hst.sampled_from(["lc", "clipper", "teaser", "mac", "gtm"]),
)
def test_no_rival_exceeds_the_bound(problem: Problem, tolerance: float, method: str) -> None:
    matches = problem.correspondences()
    group = cgroup.group(matches, method)
    try:
        facts = cgroup.certify(matches, group, tolerance=tolerance).diagnostics
    except NoConsensusError:
        return
    model = group.transform() if group.model is None else group.model
    laid, largest = reference.largest_rival(problem.source, problem.target, model, tolerance)
    assert facts["inliers"] == laid
    assert largest <= facts["bound"] <= len(matches)
    assert facts["optimal"] == (facts["bound"] < laid)


@given(seed=SEEDS, share=hst.floats(0.1, 0.9))
@FEW
def test_clear_groups_are_proved(seed: int, share: float) -> None:
    problem = make_problem(np.random.default_rng(seed), 1000, inlier_ratio=share)
    matches = problem.correspondences()
    for method in ("lc", "clipper", "teaser", "mac"):
        assert cgroup.certify(matches, cgroup.group(matches, method)).diagnostics["optimal"]


def test_a_second_motion_of_the_same_size_is_no_proof() -> None:
    matches, _ = several(4, [40, 40], 20)
    facts = cgroup.certify(matches, cgroup.group(matches)).diagnostics
    assert facts["bound"] >= 40
    assert not facts["optimal"]
