"""Several methods on the same correspondences."""

import numpy as np
import pytest

from cgroup import Correspondences
from cgroup.comparison import compare, find_correct
from cgroup.errors import InputError
from cgroup.evaluation import score_group
from strategies import rigid

POSE = rigid((0, 0, 1), 0, (1, 2, 3))


@pytest.fixture
def matches() -> Correspondences:
    """Sixty matches, forty of them correct."""
    rng = np.random.default_rng(0)
    source = rng.uniform(size=(60, 3))
    target = source + POSE[:3, 3]
    target[40:] = rng.uniform(size=(20, 3)) + 9
    return Correspondences(source, target, resolution=0.01)


def test_methods_are_named_as_they_begin(matches: Correspondences) -> None:
    begun: list[str] = []
    results = compare(matches, POSE, methods=["gc", "ransac"], progress=begun.append)
    assert begun == []
    assert next(results).method == "gc"
    assert begun == ["gc"]
    assert [result.method for result in results] == ["ransac"]
    assert begun == ["gc", "ransac"]
    with pytest.raises(InputError, match="ss needs `similarity`"):
        next(compare(matches, POSE))  # all of them, of which ss is the first


def test_correct_matches_may_be_given(matches: Correspondences) -> None:
    correct = find_correct(matches, POSE)
    assert correct.tolist() == [True] * 40 + [False] * 20
    (found,) = compare(matches, POSE, methods=["gtm"])
    (given,) = compare(matches, POSE, methods=["gtm"], correct=correct)
    assert found.score == given.score == score_group(found.grouping.mask, correct)
    (inverted,) = compare(matches, POSE, methods=["gtm"], correct=~correct)
    assert inverted.score.correct == 20
    assert inverted.score.selected_correct == found.score.selected - found.score.selected_correct


def test_tolerance_is_five_times_the_resolution(matches: Correspondences) -> None:
    moved = Correspondences(matches.source, matches.target + np.array([0.04, 0, 0]), resolution=0.01)
    assert find_correct(moved, POSE).sum() == 40
    assert find_correct(moved, POSE, tolerance=0.03).sum() == 0
    for call in (find_correct, lambda *given: next(compare(*given, methods=["gtm"]))):
        with pytest.raises(InputError, match="tolerance"):
            call(Correspondences(matches.source, matches.target), POSE)


def test_a_pair_is_registered_by_its_pose(matches: Correspondences) -> None:
    (result,) = compare(matches, POSE, methods=["gc"])
    assert result.registered
    assert result.rotation_error < 1
    assert result.displacement < 1e-9
    moved = POSE.copy()
    moved[0, 3] += 0.06
    correct = find_correct(matches, POSE)
    (off,) = compare(matches, moved, methods=["gc"], correct=correct)
    assert off.displacement == pytest.approx(0.06)
    assert off.score.registered
    assert not off.registered
    (allowed,) = compare(matches, moved, methods=["gc"], correct=correct, max_displacement=0.07)
    assert allowed.registered


@pytest.mark.parametrize("limits", [{}, {"max_rotation": 6}])
def test_a_pose_that_turns_too_far_is_not_registered(matches: Correspondences, limits: dict) -> None:
    turn = rigid((0, 0, 1), np.degrees(0.1))
    options = {"methods": ["gc"], "correct": find_correct(matches, POSE), "max_displacement": 1.0, **limits}
    (result,) = compare(matches, POSE @ turn, **options)
    assert result.rotation_error == pytest.approx(np.degrees(0.1))
    assert result.registered == bool(limits)


def test_no_pose_is_not_registered() -> None:
    rng = np.random.default_rng(1)
    scattered = Correspondences(rng.uniform(size=(3, 3)), 9 * rng.uniform(size=(3, 3)), resolution=1e-6)
    (result,) = compare(scattered, POSE, methods=["gc"])
    assert result.T_target_source is None
    assert not result.registered
    assert np.isnan(result.displacement)


def test_limits_need_a_resolution(matches: Correspondences) -> None:
    unknown = Correspondences(matches.source, matches.target)
    options = {"methods": ["st"], "correct": find_correct(matches, POSE)}
    with pytest.raises(InputError, match="max_displacement"):
        next(compare(unknown, POSE, **options))
    (result,) = compare(unknown, POSE, **options, max_displacement=0.05)
    assert result.score.correct == 40
