"""Covariances of poses: that they hold where the true pose is known, and what each convention means."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cgroup.datasets import standin_pair
from cgroup.datasets.generated.worlds import make_world_pair
from cgroup.errors import CgroupError, InputError
from cgroup.registration import register
from cgroup.registration.judge import say_motion
from cgroup.rigid import apply, invert
from cgroup.rigid.se3 import adjoint, covariance_in, deviations_at, motion, vector_of
from cgroup.rigid.transforms import axis_of

if TYPE_CHECKING:
    from cgroup.types import FloatArray

ORIGIN = np.zeros(3)
SMALL = 1e-6


def vectors(largest: float) -> Any:
    return st.lists(st.floats(-largest, largest), min_size=6, max_size=6).map(np.array)


@given(vectors(1.5), vectors(10))
def test_a_motion_is_read_back(vector: FloatArray, place: FloatArray) -> None:
    np.testing.assert_allclose(vector_of(motion(vector, place[:3]), place[:3]), vector, atol=1e-9)


@given(vectors(2), vectors(SMALL))
def test_the_adjoint_takes_a_motion_to_the_other_frame(at: FloatArray, small: FloatArray) -> None:
    pose = motion(at, ORIGIN)
    moved = motion(adjoint(pose) @ small, ORIGIN) @ pose
    np.testing.assert_allclose(moved, pose @ motion(small, ORIGIN), atol=1e-10)


MIDDLE = np.array([100.0, 200.0, -300.0])


def turning(axis: tuple[float, float, float], through: FloatArray, pitch: float = 0.0) -> FloatArray:
    """Return a small turn about an axis through a point, with a slide along it."""
    turn = -1e-2 * np.array(axis) / np.linalg.norm(axis)
    return np.concatenate([turn, np.cross(through, turn) + pitch * turn])


@pytest.mark.parametrize(
    ("vector", "words"),
    [
        (np.array([0, 0, 0, 3, -4, -1e-4]), "slide along (-0.60, 0.80, 0.00)"),
        (turning((3, 0, 4), MIDDLE + 5), "turn about an axis along (0.60, 0.00, 0.80)"),
        (turning((0, 0, 1), MIDDLE, 5), "turn about an axis along (0.00, 0.00, 1.00) while sliding along it"),
        (turning((0, 0, 1), MIDDLE + np.array([1e4, 0, 0])), "slide along (0.00, 1.00, 0.00)"),
    ],
)
def test_motions_in_words(vector: FloatArray, words: str) -> None:
    points = MIDDLE + np.random.default_rng(0).normal(size=(500, 3)) * 3
    assert say_motion(vector, points) == words


@pytest.mark.parametrize("degrees", [0.01, 1.0, 89.0, 91.0, 179.0, 179.9999, 180.0])
def test_axes_of_turns(degrees: float) -> None:
    axis = np.array([0.48, -0.6, 0.64])
    found = axis_of(motion(np.concatenate([np.radians(degrees) * axis, ORIGIN]), ORIGIN))
    np.testing.assert_allclose(found if degrees < 180 else found * np.sign(found[0]), axis, atol=1e-6)


def test_deviations_are_those_of_the_middle() -> None:
    covariance = np.diag([0, 0, 1e-4, 0, 0, 4.0])  # turns about z, slides along it
    degrees, length = deviations_at(covariance, np.array([3.0, 4, 0]))
    assert degrees == pytest.approx(np.degrees(0.01))
    assert length == pytest.approx(np.hypot(0.01 * 5, 2))


def as_gtsam(pose: FloatArray, true: FloatArray) -> FloatArray:
    """``Pose3::Logmap(pose.inverse() * true)``, of small motions."""
    return vector_of(invert(pose) @ true, ORIGIN)


def as_g2o(pose: FloatArray, true: FloatArray) -> FloatArray:
    """``toVectorMQT(pose.inverse() * true)``."""
    turn, shift = np.split(vector_of(invert(pose) @ true, ORIGIN), 2)
    angle = float(np.linalg.norm(turn))
    return np.concatenate([shift, np.sin(angle / 2) * turn / angle])


def as_ros(pose: FloatArray, true: FloatArray) -> FloatArray:
    """Position, and rotation about fixed axes."""
    turned = true[:3, :3] @ pose[:3, :3].T
    angles = [turned[2, 1], turned[0, 2], turned[1, 0]]
    return np.concatenate([true[:3, 3] - pose[:3, 3], angles])


@pytest.mark.parametrize(("convention", "errors_in"), [("gtsam", as_gtsam), ("g2o", as_g2o), ("ros", as_ros)])
@given(at=vectors(2), seed=st.integers(0, 1000))
def test_a_convention_is_that_of_the_library(convention: Any, errors_in: Any, at: Any, seed: int) -> None:
    """Errors drawn along the axes of the ellipsoid have their covariance in the library's own coordinates."""
    pose, rng = motion(at, ORIGIN), np.random.default_rng(seed)
    axes = SMALL * rng.normal(size=(6, 6))
    errors = np.array([errors_in(pose, motion(axis, ORIGIN) @ pose) for axis in axes])
    expected, found = errors.T @ errors, covariance_in(convention, axes.T @ axes, pose)
    np.testing.assert_allclose(found, expected, atol=1e-3 * np.abs(expected).max())


def test_a_covariance_turns_with_the_frame_of_the_target() -> None:
    pair = standin_pair(pixels=60)
    turn = motion(np.array([0.3, -0.2, 0.5, 20.0, -10.0, 30.0]), ORIGIN)
    one = register(pair.source, pair.target)
    with pytest.raises(InputError, match="convention"):
        one.covariance_in("ceres")  # pyright: ignore[reportArgumentType]
    other = register(pair.source, apply(turn, pair.target.points), voxel=one.voxel)
    expected = np.sqrt(np.diag(adjoint(turn) @ one.covariance @ adjoint(turn).T))
    ratios = np.sqrt(np.diag(other.covariance)) / expected
    assert ratios.min() > 1 / 3  # voxels lie elsewhere
    assert ratios.max() < 3


@pytest.mark.parametrize("kind", ["heap", "room"])
def test_errors_are_such_as_the_covariance_says(kind: str) -> None:
    """The squared Mahalanobis distance of the true pose is 6 on average, and seldom above 12.6."""
    distances = []
    for seed in range(8):
        pair = make_world_pair(np.random.default_rng((seed, *b"covariance", *kind.encode())), kind)
        try:
            done = register(pair.source, pair.target, source_viewpoint=(0, 0, 0), target_viewpoint=(0, 0, 0))
        except CgroupError:
            continue
        error = vector_of(pair.T_target_source @ invert(done.T_target_source), ORIGIN)
        if np.linalg.norm(error[:3]) < np.radians(5):
            distances.append(error @ np.linalg.solve(done.covariance, error))
    assert len(distances) >= 5
    assert np.mean(np.array(distances) < 12.6) >= 0.8
    assert 0.2 < np.median(distances) < 12
