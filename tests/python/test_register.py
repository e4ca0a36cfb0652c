"""`register` from cloud to pose: what it takes, what it gives, and what must not change its answer."""

from typing import Any

import numpy as np
import pytest
from register_shapes import FloatArray, arrow, best_guess, cube, cylinder, moved, plane

from cgroup.datasets import standin_pair
from cgroup.errors import InputError, NoConsensusError
from cgroup.registration import DenseFront, PaperFront, Registration, prepare, register
from cgroup.rigid import apply, invert, rotation_error
from strategies import rigid

PAIR = standin_pair(pixels=80)
SOURCE, TARGET, TRUTH = PAIR.source.points, PAIR.target.points, PAIR.T_target_source
EYE = (0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def done() -> Registration:
    told: list[str] = []
    copies = SOURCE.copy(), TARGET.copy()
    found = register(PAIR.source, PAIR.target, progress=told.append)
    np.testing.assert_array_equal(SOURCE, copies[0])
    np.testing.assert_array_equal(TARGET, copies[1])
    assert told == ["voxel size", "search"]
    assert next(iter(found.seconds)) == "voxel size"
    assert {"levels", "matching", "grouping", "verification"} <= set(found.seconds)
    return found


@pytest.fixture(scope="module")
def refusal() -> NoConsensusError:
    """Two shapes that have nothing to do with each other."""
    with pytest.raises(NoConsensusError) as caught:
        register(SOURCE, standin_pair(seed=5, pixels=80).target)
    return caught.value


def is_right(done: Registration, truth: FloatArray = TRUTH, source: FloatArray = SOURCE) -> bool:
    away = apply(done.T_target_source, source) - apply(truth, source)
    return bool(np.linalg.norm(away, axis=1).max() < 0.5 * done.voxel)


def same_bits(one: Registration, other: Registration) -> bool:
    arrays = ("T_target_source", "covariance", "alternatives")
    numbers = ("probability", "fitness", "inlier_rmse", "voxel", "notes")
    return (
        all(np.array_equal(getattr(one, name), getattr(other, name)) for name in arrays)
        and all(getattr(one, name) == getattr(other, name) for name in numbers)
        and np.array_equal(one.grouping.mask, other.grouping.mask)
        and np.array_equal(one.correspondences.target, other.correspondences.target)
    )


def test_the_result_says_what_was_found(done: Registration) -> None:
    assert done.ok
    assert is_right(done)
    assert 0.9 < done.probability <= 1
    assert 0.5 < done.fitness <= 1
    assert 0 < done.inlier_rmse < 0.3 * done.voxel
    assert done.open_motion is None
    assert done.alternatives.shape == (len(done.alternatives), 4, 4)
    assert len(done.grouping.mask) == len(done.correspondences)
    matches, mask = done.correspondences, done.grouping.mask
    residuals = np.linalg.norm(apply(done.T_target_source, matches.source) - matches.target, axis=1)
    np.testing.assert_array_equal(mask, residuals <= 2 * done.voxel)
    np.testing.assert_allclose(done.covariance, done.covariance.T, rtol=1e-9)
    assert np.linalg.eigvalsh(done.covariance).min() > 0
    assert all(seconds >= 0 for seconds in done.seconds.values())


def test_prepared_scans_give_the_same_bits(done: Registration) -> None:
    source, target = (prepare(cloud, voxel=done.voxel) for cloud in (SOURCE, TARGET))
    for clouds in ((source, target), (source, TARGET), (PAIR.source, target)):
        assert same_bits(register(*clouds), done)
    with_eyes = register(SOURCE, TARGET, source_viewpoint=EYE, target_viewpoint=EYE)
    source, target = (prepare(cloud, voxel=done.voxel, viewpoint=EYE) for cloud in (SOURCE, TARGET))
    assert same_bits(register(source, target), with_eyes)


@pytest.mark.parametrize(
    "option", [{"voxel": 4.0}, {"source_viewpoint": (9, 9, 9)}, {"front": DenseFront(support=4)}]
)
def test_what_a_prepared_scan_no_longer_can_change_is_refused(option: dict[str, Any]) -> None:
    source = prepare(SOURCE, voxel=3.0, viewpoint=EYE)
    assert register(source, TARGET, voxel=3.0, source_viewpoint=EYE, front=DenseFront()).ok
    with pytest.raises(InputError, match="prepare"):
        register(source, TARGET, **option)


def test_scans_prepared_with_different_voxels_are_refused() -> None:
    with pytest.raises(InputError, match="voxels of 3 and 3.5; prepare"):
        register(prepare(SOURCE, voxel=3.0), prepare(TARGET, voxel=3.5))


@pytest.mark.parametrize(
    ("source", "options"),
    [
        (np.asfortranarray(SOURCE), {}),
        (np.repeat(SOURCE, 2, axis=0)[::2], {}),
        (SOURCE.tolist(), {}),
        *((SOURCE, {"threads": threads}) for threads in (1, 2, 3)),
        (SOURCE, {"effort": "high"}),  # which is spared where the pose is sure
    ],
)
def test_layout_threads_and_effort_change_no_bit(
    done: Registration, source: Any, options: dict[str, Any]
) -> None:
    assert same_bits(register(source, TARGET, **options), done)


@pytest.mark.parametrize(
    "options",
    [
        {"voxel": 2.5},
        {"voxel": 5.0},
        {"source_viewpoint": EYE, "target_viewpoint": EYE},
        {"target_viewpoint": EYE},
        {"method": "gtm"},
    ],
    ids=str,
)
def test_the_pose_is_found_with_any_option(options: dict[str, Any]) -> None:
    found = register(SOURCE, TARGET, **options)
    assert found.ok
    assert is_right(found)
    assert rotation_error(found.T_target_source, TRUTH) < 1
    assert found.voxel == options.get("voxel", found.voxel)


@pytest.mark.parametrize("method", ["gtm", "lc"])
def test_the_paper_s_front_takes_any_method(method: str) -> None:
    found = register(PAIR.source, PAIR.target, front=PaperFront(keypoints=300), method=method)
    assert found.ok
    assert is_right(found)


def test_clouds_that_share_nothing_are_refused_with_the_best_guess(refusal: NoConsensusError) -> None:
    best = refusal.registration
    assert best is not None
    assert not best.ok
    assert best.probability < 0.5
    message = str(refusal)
    assert message.startswith("no reliable pose: ")
    assert f"{best.probability:.2f}" in message
    assert "give the scanner's position by `viewpoint`" in message


@pytest.mark.parametrize("seed", range(2))
def test_an_axis_decides_between_the_poses_of_a_symmetric_shape(seed: int) -> None:
    truth = rigid((0, 0, 1), np.degrees(1 + 2 * seed), (3, 2, 1))
    source, target = arrow(2 * seed), apply(truth, arrow(2 * seed + 1))
    free = best_guess(source, target)
    poses = [free.T_target_source, *free.alternatives]
    assert {round(pose[2, 2]) for pose in poses} == {1, -1}
    found = best_guess(source, target, axis=(0, 0, 5))
    assert is_right(found, truth, source)
    assert all(pose[2, 2] > np.cos(np.radians(10)) for pose in found.alternatives)


def test_a_symmetric_shape_has_alternatives() -> None:
    target, motion = moved(cube(1))
    found = best_guess(cube(0), target)
    assert len(found.alternatives) > 3
    assert any("symmetric" in note for note in found.notes)
    for pose in (found.T_target_source, *found.alternatives):
        turned = invert(motion) @ pose
        np.testing.assert_allclose(np.sort(np.abs(turned[:3, :3]), axis=1), [[0, 0, 1]] * 3, atol=0.05)
        np.testing.assert_allclose(turned[:3, 3], 0, atol=0.05)


@pytest.mark.parametrize(
    ("shape", "how", "open_rows"),
    [(plane, "turn about an axis along", [2]), (cylinder, "slide along", [0, 1])],
)
def test_what_the_surfaces_leave_open_is_said(shape: Any, how: str, open_rows: list[int]) -> None:
    points = shape(3)
    found = best_guess(shape(2), points)
    assert found.open_motion is not None
    assert f"the source is free to {how} (0.00, 0.00, 1.00): the surfaces hardly resist that" in found.notes
    moves = np.cross(found.open_motion[:3], points) + found.open_motion[3:]
    # Some five voxels along it, and as nothing across.
    at = found.open_motion / np.linalg.norm(moves, axis=1).mean()
    assert at @ np.linalg.solve(found.covariance, at) < (1 / (4 * found.voxel)) ** 2
    outwards = np.zeros_like(points)
    outwards[:, open_rows] = points[:, open_rows] if shape is cylinder else 1
    along = np.abs((moves * outwards).sum(axis=1)).mean()
    assert along < 0.1 * np.linalg.norm(moves, axis=1).mean()
