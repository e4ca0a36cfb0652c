"""The last refinement of a pose: against the reference, under motions, on planes, and on bad input."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cgroup import InputError, features
from cgroup.datasets import standin_pair
from cgroup.rigid import apply, invert, rotation_error
from cgroup.verification import Alignment, FineSurface, align
from cgroup.verification.alignment import plane_distances, sample_points
from reference import alignment as reference
from strategies import FloatArray, random_motion

PAIR = standin_pair(pixels=80)
TRUTH = PAIR.T_target_source
SPACING = 1.5 * features.resolution(PAIR.source.points)


def bumpy(rng: np.random.Generator, count: int) -> FloatArray:
    """A noisy height field over 16 x 16."""
    xy = rng.uniform(-8, 8, size=(count, 2))
    z = 2 * np.sin(0.5 * xy[:, 0]) * np.cos(0.4 * xy[:, 1]) + 0.05 * rng.normal(size=count)
    return np.column_stack([xy, z])


def small_motion(rng: np.random.Generator, angle: float, shift: float) -> FloatArray:
    motion = np.eye(4)
    motion[:3, :3] = reference.rotation_of(rng.normal(size=3) * angle)
    motion[:3, 3] = rng.normal(size=3) * shift
    return motion


def surfaces(
    source: FloatArray = PAIR.source.points,
    target: FloatArray = PAIR.target.points,
    spacing: float = SPACING,
    **options: Any,
) -> tuple[FineSurface, FineSurface]:
    return FineSurface(source, spacing, **options), FineSurface(target, spacing, **options)


def near_truth(seed: int = 0) -> FloatArray:
    rng = np.random.default_rng(seed)
    about = np.eye(4)
    about[:3, 3] = PAIR.target.points.mean(axis=0)
    return about @ small_motion(rng, 0.01, 0.5 * SPACING) @ invert(about) @ TRUTH


def same_bits(one: Alignment, other: Alignment) -> bool:
    names = ("T_target_source", "residuals", "deviations", "information")
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in names)


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1),
    unit=st.sampled_from([1e-3, 1.0, 250.0]),
    offset=st.sampled_from([0.0, 1e3, 1e5]),
    away=st.sampled_from([0.0, 0.4, 4.0, 100.0]),
)
def test_equals_the_reference(seed: int, unit: float, offset: float, away: float) -> None:
    rng = np.random.default_rng(seed)
    motion = random_motion(rng, offset * unit)
    source = bumpy(rng, int(rng.integers(300, 600))) * unit
    target = apply(motion, bumpy(rng, int(rng.integers(300, 600))) * unit)
    pose = motion @ small_motion(rng, 0.03, away * unit)
    expected = reference.align(
        reference.fine_surface(source, unit), reference.fine_surface(target, unit), pose
    )
    found = align(*surfaces(source, target, unit), pose)
    close = {"rtol": 1e-6, "atol": 1e-7 * unit * (1 + away)}
    np.testing.assert_allclose(apply(found.T_target_source, source), apply(expected.pose, source), **close)
    # A plane's normal has no sign, and neither has the distance from it.
    for one, other in (
        (np.abs(found.residuals), np.abs(expected.residuals)),
        (found.deviations, expected.deviations),
    ):
        np.testing.assert_allclose(np.sort(one), np.sort(other), **close)
    assert found.paired == expected.paired
    scale = np.abs(expected.information).max()
    np.testing.assert_allclose(found.information, expected.information, atol=1e-6 * scale)
    if abs(expected.resistance - reference.OPEN) > 1e-6:
        assert (found.open_motion is not None) == (expected.resistance < reference.OPEN)


@settings(max_examples=30)
@given(
    seed=st.integers(0, 2**32 - 1),
    unit=st.sampled_from([1e-3, 1.0, 250.0]),
    away=st.sampled_from([0.0, 0.4, 4.0, 100.0]),
)
def test_distances_from_planes_equal_the_reference(seed: int, unit: float, away: float) -> None:
    rng = np.random.default_rng(seed)
    source, target = (bumpy(rng, int(rng.integers(300, 600))) * unit for _ in range(2))
    pose = small_motion(rng, 0.03, away * unit)
    ours = surfaces(source, target, unit)
    one, other = (reference.fine_surface(cloud, unit) for cloud in (source, target))
    expected = reference.plane_distances(one, other, *reference.in_spacings(one, other, pose)) * unit
    found, places = plane_distances(*ours, pose, None), sample_points(ours[0])
    feet = one.feet @ one.axes * unit + one.center
    # Samples stand in the order drawn; places tell which is which.
    rows = np.linalg.norm(places[:, None] - feet, axis=2).argmin(axis=1)
    np.testing.assert_allclose(places, feet[rows], atol=1e-6 * unit)
    assert len(set(rows.tolist())) == len(feet)
    np.testing.assert_allclose(found, expected[rows], rtol=1e-6, atol=1e-7 * unit * (1 + away))


def test_the_reference_mostly_comes_to_rest() -> None:
    settled = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        both = [reference.fine_surface(bumpy(rng, 500), 1.0) for _ in range(2)]
        settled.append(reference.align(*both, small_motion(rng, 0.03, 0.4)).settled)
    assert sum(settled) >= 5


@pytest.mark.parametrize("seed", range(3))
def test_finds_the_true_pose_from_near_by(seed: int) -> None:
    start = near_truth(seed)
    found = align(*surfaces(), start)
    assert rotation_error(found.T_target_source, TRUTH) < 0.1 < rotation_error(start, TRUTH)
    away = apply(found.T_target_source, PAIR.source.points) - apply(TRUTH, PAIR.source.points)
    assert np.linalg.norm(away, axis=1).max() < 0.2 * SPACING
    assert found.paired > 0.7
    assert 0 < found.rmse < 0.2 * SPACING
    assert found.open_motion is None
    assert np.linalg.eigvalsh(found.information).min() > 0
    rotation = found.T_target_source[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert repr(found) == f"Alignment(paired={found.paired:.2f}, rmse={found.rmse:.3g})"


def test_swapped_clouds_give_the_inverse() -> None:
    source, target = surfaces()
    found, back = align(source, target, near_truth()), align(target, source, invert(near_truth()))
    away = apply(back.T_target_source @ found.T_target_source, PAIR.source.points) - PAIR.source.points
    assert np.abs(away).max() < 1e-3 * SPACING
    assert back.paired == pytest.approx(found.paired, abs=2e-3)
    assert back.rmse == pytest.approx(found.rmse, rel=2e-2)


def test_threads_and_single_precision_change_no_bit() -> None:
    one, *others = (align(*surfaces(threads=n), near_truth(), threads=n) for n in (1, 2, 5))
    assert all(same_bits(one, other) for other in others)
    single = PAIR.source.points.astype(np.float32)
    clouds = (single, single.astype(np.float64), features.Cloud(single))
    one, *others = (align(*surfaces(cloud), near_truth()) for cloud in clouds)
    assert all(same_bits(one, other) for other in others)


@pytest.mark.parametrize("offset", [0.0, 1e4])
def test_a_plane_leaves_motions_open(offset: float) -> None:
    rng = np.random.default_rng(0)
    clouds = [np.column_stack([rng.uniform(0, 40, (4000, 2)), np.zeros(4000)]) + offset for _ in range(2)]
    tilted = np.eye(4)
    tilted[:3, :3] = reference.rotation_of(np.array([0.02, 0.01, 0.0]))
    tilted[:3, 3] = clouds[1].mean(axis=0) - tilted[:3, :3] @ clouds[0].mean(axis=0) + [0, 0, 0.5]
    found = align(*surfaces(*clouds, 1.0), tilted)
    assert np.abs(apply(found.T_target_source, clouds[0])[:, 2] - offset).max() < 1e-3
    assert found.rmse < 1e-3
    moves = np.cross(found.open_motion[:3], clouds[1]) + found.open_motion[3:]
    assert np.abs(moves[:, 2]).max() < 1e-2
    assert 0.1 < np.linalg.norm(moves, axis=1).mean() < 2


def test_clouds_far_apart_stay_where_they_are() -> None:
    away = np.eye(4)
    away[:3, 3] = 1e6 * SPACING
    found = align(*surfaces(), away)
    np.testing.assert_allclose(found.T_target_source, away, rtol=1e-14, atol=1e-14)
    assert (found.paired, len(found.residuals)) == (0, 0)
    assert np.isnan(found.rmse)
    assert found.open_motion is not None


GRID = np.stack(np.meshgrid(*[np.arange(20.0)] * 2, [0.0]), axis=-1).reshape(-1, 3)


@pytest.mark.parametrize(
    ("points", "spacing", "words"),
    [
        (np.empty((0, 3)), 1.0, "spacing: got 1"),
        (np.ones((50, 3)), 1.0, "about the distance between points"),
        (GRID * [1, 0, 0], 1.0, "about the distance between points"),
        (GRID, 0.1, "about the distance between points"),
        (GRID, 100.0, "about the distance between points"),
        (GRID, 1e-30, "larger voxel"),
        (GRID, 0, "spacing: got 0"),
        (GRID, np.nan, "spacing: got nan"),
        (np.where(GRID == 3, np.nan, GRID), 1.0, "coordinates must be finite"),
        (GRID[:, :2], 1.0, "shape"),
    ],
)
def test_fine_surfaces_that_make_no_sense_are_refused(points: FloatArray, spacing: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        FineSurface(points, spacing)


def test_what_cannot_be_aligned_is_refused() -> None:
    for pose in ([np.eye(4), np.eye(4)], np.eye(3), np.diag([1.0, 1, -1, 1]), 2 * np.eye(4)):
        with pytest.raises(InputError, match="pose"):
            align(*surfaces(), pose)
    with pytest.raises(InputError, match="same spacing"):
        align(surfaces()[0], FineSurface(PAIR.target.points, 1.01 * SPACING), TRUTH)
