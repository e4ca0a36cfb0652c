"""Poses judged on surfaces: against the reference, under motions, on generated scans, and on bad input."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cgroup import Correspondences, InputError, features
from cgroup.datasets import standin_pair
from cgroup.rigid import apply, invert, rotation_error
from cgroup.verification import Surface, score_poses, verify
from reference import verification as reference
from strategies import FloatArray, random_motion, random_rotations, rigid

PAIR = standin_pair(pixels=70)
PR = features.resolution(PAIR.source.points)
TRUTH = PAIR.T_target_source


def scans(**options: Any) -> tuple[Surface, Surface]:
    return tuple(  # type: ignore[return-value]
        Surface(scan.points, features.normals(scan.points), unit=0.4 * PR, **options)
        for scan in (PAIR.source, PAIR.target)
    )


SOURCE, TARGET = scans(viewpoint=(0, 0, 0))


def poses_near_and_far(count: int, seed: int = 0) -> FloatArray:
    """The truth moved by up to 2 pr, last, among random ones that carry one centre to the other."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = random_rotations(rng, count)
    centers = PAIR.source.points.mean(axis=0), PAIR.target.points.mean(axis=0)
    poses[:, :3, 3] = centers[1] - poses[:, :3, :3] @ centers[0] + rng.normal(size=(count, 3)) * 5 * PR
    poses[-1] = TRUTH
    poses[-1, :3, 3] += rng.uniform(-1, 1, size=3) * 2 * PR
    return poses


def bumpy(rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
    """A height field over 20 x 20 with noisy normals, in units."""
    xy = rng.uniform(-10, 10, size=(count, 2))
    phase = rng.uniform(0, 6, size=2)
    z = 2 * np.sin(0.5 * xy[:, 0] + phase[0]) * np.cos(0.4 * xy[:, 1] + phase[1])
    normals = np.column_stack([-np.gradient(z), rng.normal(size=count) * 0.3, np.ones(count)])
    normals[:, 0] = rng.normal(size=count) * 0.3
    return np.column_stack([xy, z]), normals * rng.uniform(0.1, 9, size=(count, 1))


@given(
    seed=st.integers(0, 2**32 - 1),
    view=st.sampled_from(["none", "oriented", "viewpoint"]),
    unit=st.sampled_from([1e-3, 1.0, 250.0]),
    offset=st.sampled_from([0.0, 1e3, 1e5]),
    turn=st.sampled_from([0.0, 0.2, 3.0]),
)
def test_scores_are_those_of_the_reference(
    seed: int, view: str, unit: float, offset: float, turn: float
) -> None:
    rng = np.random.default_rng(seed)
    motion = random_motion(rng, offset * unit)
    clouds, options = [], []
    for place in (np.eye(4), motion):
        points, normals = bumpy(rng, int(rng.integers(30, 150)))
        normals[rng.uniform(size=len(normals)) < 0.1] = rng.choice([0.0, np.nan])
        eye = np.array([[1.0, 2.0, 40.0]]) * unit
        clouds.append((apply(place, points * unit), normals @ place[:3, :3].T))
        option: dict[str, Any] = {"unit": unit}
        if view == "viewpoint":
            option["viewpoint"] = apply(place, eye)[0]
        elif view == "oriented":
            option["oriented"] = True
        options.append(option)
    angle = np.degrees(turn * rng.uniform())
    wobble = rigid((0, 0, 1), angle, rng.normal(size=3) * unit * (1 + turn))
    pose = motion @ wobble
    expected, doubt = reference.score(
        *(reference.surface(*cloud, **option) for cloud, option in zip(clouds, options, strict=True)), pose
    )
    source, target = (Surface(*cloud, **option) for cloud, option in zip(clouds, options, strict=True))
    assert score_poses(source, target, pose)[0] == pytest.approx(expected, abs=doubt)


def test_both_directions_give_the_same_scores() -> None:
    poses = poses_near_and_far(40)
    back = score_poses(TARGET, SOURCE, np.array([invert(pose) for pose in poses]))
    np.testing.assert_allclose(back, score_poses(SOURCE, TARGET, poses), atol=0.01)


@pytest.mark.parametrize("options", [{"viewpoint": (0, 0, 0)}, {"oriented": True}, {}])
def test_the_true_pose_is_found_among_random_ones(options: dict[str, Any]) -> None:
    source, target = scans(**options)
    poses = poses_near_and_far(300)
    found = verify(source, target, poses)
    assert rotation_error(found.T_target_source, TRUTH) < 0.5
    assert (
        np.abs(apply(found.T_target_source, PAIR.source.points) - apply(TRUTH, PAIR.source.points)).max() < PR
    )
    assert found.score > score_poses(source, target, poses).max()
    assert found.margin > 0.5
    assert found.fitness > 0.7
    assert 0 < found.inlier_rmse < 0.5 * PR
    assert found.open_motion is None


def test_what_comes_back_is_in_order() -> None:
    found = verify(SOURCE, TARGET, poses_near_and_far(200))
    assert found.poses.shape == (len(found.scores), 4, 4)
    assert len(found.evidence) == len(found.scores) <= 12
    assert (np.diff(np.log(np.maximum(found.scores, 1e-6))) <= 0).all()
    np.testing.assert_array_equal(found.T_target_source, found.poses[0])
    assert found.score == found.scores[0]
    np.testing.assert_allclose(score_poses(SOURCE, TARGET, found.poses), found.scores, atol=0.01)
    np.testing.assert_allclose(found.information, found.information.T)
    assert np.linalg.eigvalsh(found.information).min() > 0
    alone = verify(SOURCE, TARGET, TRUTH)
    assert (len(alone.poses), alone.margin) == (1, np.inf)


def test_matches_speak_for_the_refined_pose() -> None:
    rng = np.random.default_rng(0)
    rows = rng.choice(len(PAIR.source.points), 30)
    matched = apply(TRUTH, PAIR.source.points[rows])
    matched[10:] += 100 * PR
    matches = Correspondences(PAIR.source.points[rows], matched)
    poses = poses_near_and_far(200)
    poses[-1, :3, 3] = TRUTH[:3, 3] + 2 * PR  # 3.5 pr away: no match is within 1.5 pr before the refinement
    without, found = verify(SOURCE, TARGET, poses), verify(SOURCE, TARGET, poses, matches=matches)
    assert (without.evidence == 0).all()
    assert found.evidence[0] == 10
    assert found.margin > without.margin
    assert verify(SOURCE, TARGET, poses, matches=matches, match_tolerance=1e3 * PR).evidence[0] == 30


@pytest.mark.parametrize("offset", [0.0, 1e4])
def test_a_plane_leaves_motions_open(offset: float) -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0, 40, size=(2000, 2)), np.zeros(2000)]) + offset
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    plane = Surface(points, normals, unit=0.4, oriented=True)
    found = verify(plane, plane, np.eye(4))
    turn, shift = found.open_motion[:3], found.open_motion[3:]
    moves = np.cross(turn, points) + shift
    assert np.abs(moves[:, 2]).max() < 1e-3
    assert 0.1 < np.linalg.norm(moves, axis=1).mean() < 1
    # The surface resists a tilt as the sum of the squares of what it makes of the distances.
    tilt = np.array([0.01, 0.02, 0, 0, 0, 0.0])
    tilt[3:] = -np.cross(tilt[:3], points.mean(axis=0))
    weight = found.information[5, 5]
    expected = weight * ((np.cross(tilt[:3], points) + tilt[3:])[:, 2] ** 2).mean()
    assert tilt @ found.information @ tilt == pytest.approx(expected, rel=0.1)


def test_free_space_counts_against_a_pose() -> None:
    between = TRUTH.copy()
    towards = PAIR.target.points.mean(axis=0)
    between[:3, 3] -= 0.3 * towards  # well before what the target's scanner saw
    blind = scans()
    assert score_poses(*blind, between)[0] >= 0
    assert score_poses(SOURCE, TARGET, between)[0] < -0.3


def test_any_number_of_threads_gives_the_same_bits() -> None:
    poses = poses_near_and_far(300)

    def run(threads: int) -> list[bytes]:
        found = verify(*scans(viewpoint=(0, 0, 0), threads=threads), poses, threads=threads)
        arrays = (found.poses, found.scores, found.information, np.array(found.margin))
        scores = score_poses(SOURCE, TARGET, poses, threads=threads)
        return [array.tobytes() for array in (*arrays, scores)]

    assert run(1) == run(2) == run(5)


GRID = np.stack(np.meshgrid(*[np.arange(20.0)] * 2, [0.0]), axis=-1).reshape(-1, 3)
UP = np.tile([0.0, 0.0, 1.0], (len(GRID), 1))


@pytest.mark.parametrize(
    ("points", "normals", "options", "words"),
    [
        (np.empty((0, 3)), np.empty((0, 3)), {}, "unit: got"),
        (GRID[:3] * 100, UP[:3], {}, "at least 10 points"),
        (GRID, UP[:-1], {}, "399 for 400 points"),
        (GRID, np.full_like(UP, np.nan), {}, "normals: got 0"),
        (np.where(GRID == 3, np.nan, GRID), UP, {}, "row"),
        (GRID, UP, {"unit": 0}, "greater than 0"),
        (GRID, UP, {"unit": 1e3}, "of which the 400 points span"),
        (GRID * [1e6, 1, 1], UP, {}, "larger unit"),
        (GRID, UP, {"viewpoint": (0, 0, np.inf)}, "three finite numbers"),
        (GRID, UP, {"viewpoint": (0, 0, 1e12)}, "scanner's place"),
    ],
)
def test_surfaces_that_make_no_sense_are_refused(
    points: FloatArray, normals: FloatArray, options: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        Surface(points, normals, **{"unit": 0.4, **options})


def test_poses_that_make_no_sense_are_refused() -> None:
    mirrored = [np.eye(4), np.diag([1.0, 1, -1, 1])]
    for function in (verify, score_poses):
        with pytest.raises(InputError, match="at least one"):
            function(SOURCE, TARGET, np.empty((0, 4, 4)))
        with pytest.raises(InputError, match=r"poses\[1\]: its upper left 3x3 block is a reflection"):
            function(SOURCE, TARGET, mirrored)
