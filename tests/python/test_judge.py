"""What a pose is trusted for: numbers by hand, at and beside every bound."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cgroup._core import weigh
from cgroup.datasets import standin_pair
from cgroup.registration import prepare
from cgroup.registration.judge import Case, Found, bound_by_motions, choose_apart, judge, share_probability
from cgroup.scenes.links import Link
from cgroup.types import Correspondences
from strategies import rigid

PAIR = standin_pair(pixels=40)
SCAN = prepare(PAIR.source, voxel=6.0)
CENTER = np.array([1.0, 2.0, 3.0])


def poses(*changes: tuple[float, float]) -> np.ndarray:
    """Poses that turn by so many degrees about an axis through the centre, and shift by so much."""
    made = [rigid((0, 0, 1), degrees) for degrees, _ in changes]
    for pose, (_, shift) in zip(made, changes, strict=True):
        pose[:3, 3] = CENTER - pose[:3, :3] @ CENTER + (0, 0, shift)
    return np.array(made)


@pytest.mark.parametrize(
    ("change", "differs"),
    [((9.9, 0), False), ((10.1, 0), True), ((0, 15.9), False), ((0, 16.1), True), ((9.9, 15.9), False)],
)
def test_poses_differ_beyond_ten_degrees_or_eight_voxels(change: tuple[float, float], differs: bool) -> None:
    assert choose_apart(poses((0, 0), change), CENTER, 2.0) == ([0, 1] if differs else [0])


def test_poses_apart_are_chosen_from_the_first() -> None:
    made = poses((0, 0), (9, 0), (90, 0), (95, 0), (180, 0))
    assert choose_apart(made, CENTER, 1.0) == [0, 2, 4]
    assert choose_apart(made[:1], CENTER, 1.0) == [0]


def case(
    score: float = 1.0,
    support: int = 19,
    misfit: float = 1.0,
    crossed: float = 0.0,
    cells: float = 50.0,
    planes: int = 4,
    chance: float = float("nan"),
) -> Case:
    return score, support, misfit, cells, planes, crossed, chance


def lead_over_chance(case: Case) -> float:
    """The lead of a pose over poses of unrelated scans, or over the best that chance reaches, in nats."""
    score, support, misfit, cells, planes, crossed, chance = case
    by_chance = 4 if np.isnan(chance) else 5
    nats = 2.0 * np.log(max(score, 1e-3)) + 2.1 * np.log1p(cells) + 3.0 * np.clip(planes - by_chance, 0, 3)
    nats -= 3.0 * np.log(max(misfit, 1.0))
    nats = nats if np.isnan(crossed) else nats - 5.0 * np.log1p(crossed / 0.02) + 2.8
    searched = nats + 1.35 * np.log1p(support) - 3.0 * np.log(max(misfit / 4.5, 1.0)) - chance - 0.6
    return float(nats if np.isnan(chance) else searched)


def lead_over_rivals(case: Case) -> float:
    """The evidence for a pose, in nats, to be compared with that for other poses of the same scans."""
    score, support, misfit, cells, planes, crossed, _ = case
    nats = 4.0 * np.log(max(score, 1e-3)) + 0.5 * np.log1p(min(support, 20)) + 0.8 * np.log1p(cells)
    nats += 0.6 * np.clip(planes - 4, 0, 3) - 1.5 * np.log(max(misfit, 1.0))
    return float(nats - 1.5 * np.log1p(np.nan_to_num(crossed) / 0.02))


CASES = st.tuples(
    st.floats(-1, 2),
    st.integers(0, 100),
    st.floats(0.1, 100),
    st.floats(0, 500),
    st.integers(0, 12),
    st.floats(0, 1) | st.just(float("nan")),
    st.floats(-10, 20) | st.just(float("nan")),
)


@given(cases=st.lists(CASES, min_size=1, max_size=6), scales=st.integers(1, 9))
def test_the_probability_is_that_of_the_equations(cases: list[Case], scales: int) -> None:
    leads = [lead_over_rivals(cases[0]) - lead_over_rivals(rival) for rival in cases[1:]]
    shares = np.exp(np.clip(1 - np.array(leads), -30, 1))
    none = scales * np.exp(np.clip(-lead_over_chance(cases[0]), -30, 30))
    chance, found_shares = share_probability(cases, scales)
    assert chance == pytest.approx(1 / (1 + none + shares.sum()), rel=1e-9)
    np.testing.assert_allclose(found_shares, shares, rtol=1e-9)
    np.testing.assert_allclose(
        [weigh(one) for one in cases], [lead_over_rivals(one) for one in cases], rtol=1e-9
    )


def test_equal_poses_share_and_none_is_accepted() -> None:
    assert share_probability([case()])[0] > 0.9
    for rivals in (1, 2, 5):
        assert share_probability([case()] * (1 + rivals))[0] <= 1 / (1 + rivals * np.e)


def found(**changes: Any) -> Found:
    """A pose of a sure search."""
    points = np.random.default_rng(0).uniform(-5, 5, size=(900, 3))
    matches = Correspondences(points, points + ([[2.0, 0, 0], [2.001, 0, 0], [0, 0, 0]] * 300))
    made = Found(
        np.eye(4),
        0.95,
        poses((90, 0)),
        0.8,
        0.8,
        0.1,
        None,
        matches,
        points,
        1.0,
        lambda: np.eye(6),
        lambda some: [(0.8, 0.8, 0.1)] * len(some),
    )
    return replace(made, **changes)


def test_a_pose_that_leaves_two_motions_open_is_not_trusted() -> None:
    for motions in range(4):
        chance = bound_by_motions(0.95, motions)
        assert chance == (0.95 if motions <= 1 else 1 / (1 + motions))
        judgement = judge(found(probability=chance, motions=motions), SCAN, SCAN)
        assert judgement.ok == (judgement.reason == "") == (motions <= 1)
        assert (f"free to move in {motions} of six ways" in judgement.notes[0]) == (motions > 1)


def test_a_pose_is_accepted_from_one_half() -> None:
    for share, ok in ((0.5, True), (0.4999, False), (0.0, False), (1.0, True)):
        judgement = judge(found(probability=share, alternatives=np.empty((0, 4, 4))), SCAN, SCAN)
        assert judgement.ok == ok
        words = f"only {share:.2f}: 80 % of the source overlaps the target, and 600 of 900 matches agree"
        assert (words in judgement.reason) != ok


@pytest.mark.parametrize("probability", [0.5, 0.6999, 0.7, 1.0])
def test_a_pose_with_alternatives_is_accepted_from_seven_tenths(probability: float) -> None:
    judgement = judge(found(probability=probability), SCAN, SCAN)
    assert judgement.ok == (probability >= 0.7)
    words = f"several places look the same: 2 poses share the probability, and the best has {probability:.2f}"
    assert (words in judgement.reason) != judgement.ok
    for share, is_rival in ((0.3, True), (0.299, False)):
        chances = np.array([probability, share * probability])
        one = Link(poses((0, 0), (90, 0)), chances, np.eye(6), 0.8, 0.8)
        assert one.is_accepted == (judgement.ok or not is_rival)


def test_an_accepted_pose_says_where_a_viewpoint_cannot_be_right() -> None:
    points, place = PAIR.source.points, np.array(PAIR.source_viewpoint)
    center, size = points.mean(axis=0), np.ptp(points)
    aside, sideways = center + np.array([0, size, 0]), np.cross(center - place, (0, 1, 0))
    right, wrong, askew = (
        prepare(PAIR.source, voxel=6.0, **given)
        for given in ({"viewpoint": place}, {"viewpoint": aside}, {"view_direction": sideways})
    )
    assert (
        judge(found(probability=0.9), right, right).notes == judge(found(probability=0.9), SCAN, SCAN).notes
    )
    for scan, words in ((wrong, "the viewpoint of cloud"), (askew, "along the view direction of cloud")):
        note = judge(found(probability=0.9), right, scan).notes[-1]
        assert f"{words}, points lie behind each other" in note
        assert note in judge(found(probability=0.1), right, scan).reason


@pytest.mark.parametrize("axis", [None, np.array([0.0, 0, 1])])
def test_a_search_that_found_nothing_says_what_may_help(axis: np.ndarray | None) -> None:
    large = prepare(PAIR.source.points * 1.6, voxel=6.0)
    eyed = prepare(PAIR.source, voxel=6.0, viewpoint=(0, 0, 0))
    for one, other, words in (
        (SCAN, large, "scale one"),
        (SCAN, SCAN, "give the scanner's position by `viewpoint`"),
        (eyed, SCAN, "if the target is a single scan, give `target_viewpoint` too"),
        (eyed, eyed, "give `axis`" if axis is None else ", or not the axis, or a viewpoint may be"),
    ):
        judgement = judge(None, one, other, axis)
        assert (judgement.ok, judgement.probability, judgement.notes) == (False, 0, ())
        assert ("keeps the axis" in judgement.reason) == (axis is not None)
        assert words in judgement.reason
