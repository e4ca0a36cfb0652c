"""What a pose is trusted for: numbers by hand, at and beside every bound."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cgroup.datasets import standin_pair
from cgroup.registration import prepare
from cgroup.registration.evidence import Evidence
from cgroup.registration.judge import (
    Case,
    Found,
    bound_by_motions,
    choose_apart,
    differ,
    judge,
    lead_over_chance,
    misfit,
    rank,
    share_probability,
    weigh,
)
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


def test_poses_differ_beyond_ten_degrees_or_eight_voxels() -> None:
    near_and_far = poses((0, 0), (9.9, 0), (10.1, 0), (0, 15.9), (0, 16.1), (9.9, 15.9))
    assert differ(near_and_far, 0, CENTER, 2.0).tolist() == [False, False, True, False, True, False]


def test_poses_apart_are_chosen_from_the_first() -> None:
    made = poses((0, 0), (9, 0), (90, 0), (95, 0), (180, 0))
    assert choose_apart(made, CENTER, 1.0) == [0, 2, 4]
    assert choose_apart(made[:1], CENTER, 1.0) == [0]


def case(
    score: float = 1.0, support: int = 19, misfit: float = 1.0, crossed: float = 0.0, **evidence: float
) -> Case:
    told = {"cells": 50.0, "planes": 4} | evidence
    return Case(score, support, misfit, Evidence(**told, crossed=crossed))


def test_equal_poses_share_and_none_is_accepted() -> None:
    one = case()
    alone, none = share_probability(one, [])
    assert alone > 0.9
    assert len(none) == 0
    for rivals in (1, 2, 5):
        shared, shares = share_probability(one, [case()] * rivals)
        assert shared <= 1 / (1 + rivals * np.e)
        np.testing.assert_allclose(shares, np.e)
    # A rival without any evidence takes nothing away.
    far = case(score=1e-9, support=0, misfit=50.0, crossed=0.5)
    assert share_probability(one, [far])[0] == pytest.approx(alone)


def test_probability_is_the_share_of_the_evidence() -> None:
    best, rival = case(support=9), case(score=0.8, support=4, misfit=1.5, crossed=0.02)
    shared, (share,) = share_probability(best, [rival])
    assert share == pytest.approx(np.exp(1 - (weigh(best) - weigh(rival))))
    assert shared == pytest.approx(1 / (1 + np.exp(-lead_over_chance(best)) + share))


@pytest.mark.parametrize(
    ("name", "better", "worse"),
    [("cells", 60, 20), ("planes", 5, 4), ("misfit", 1, 2), ("crossed", 0, 0.05), ("crossed", 0, np.nan)],
)
def test_evidence_has_the_sign_that_one_expects(name: str, better: Any, worse: Any) -> None:
    assert lead_over_chance(case(**{name: better})) > lead_over_chance(case(**{name: worse}))


def test_what_tells_nothing_counts_for_nothing() -> None:
    assert lead_over_chance(case(planes=0)) == lead_over_chance(case(planes=4))
    assert weigh(case(misfit=0.3)) == weigh(case(misfit=1.0))  # noise-free clouds win nothing
    assert weigh(case(support=20)) == weigh(case(support=999))
    assert weigh(case(crossed=float("nan"))) == weigh(case(crossed=0.0))


def test_misfit_and_rank_by_hand() -> None:
    alignment: Any = SimpleNamespace(residuals=np.r_[0:9, -9, 9], deviations=np.full(11, 0.3))
    nothing: Any = SimpleNamespace(residuals=np.empty(0), deviations=np.empty(0))
    expected = 9.0 / np.hypot(0.3, 0.02 * 20)  # the eighth decile is 8
    assert misfit(alignment, 20.0) == pytest.approx(expected)
    assert misfit(nothing, 20.0) == 100
    scores, evidence = np.array([0.5, -1.0, 0.5]), np.array([7, 0, 99])
    ranks = [
        np.log(0.5) + 0.75 * np.log(8) - 3 * np.log(expected + 0.1),
        np.log(1e-3) - 3 * np.log(100.1),
        np.log(0.5) + 0.75 * np.log(21) - 3 * np.log(expected + 0.1),
    ]
    np.testing.assert_allclose(rank(scores, evidence, [alignment, nothing, alignment], 20.0), ranks)


def found(**changes: Any) -> Found:
    """A pose of a sure search."""
    points = np.random.default_rng(0).uniform(-5, 5, size=(900, 3))
    refined: Any = SimpleNamespace(T_target_source=np.eye(4), open_motion=None)
    scan: Any = SimpleNamespace(voxels=SimpleNamespace(points=points), voxel=1.0)
    matches = Correspondences(points, points + ([[2.0, 0, 0], [2.001, 0, 0], [0, 0, 0]] * 300))
    made = Found(refined, poses((90, 0)), 0.95, 0.8, matches, scan, scan)
    return replace(made, **changes)  # fmt: skip


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
