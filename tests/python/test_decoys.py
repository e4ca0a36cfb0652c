"""The share of wrong poses among accepted ones, from mirrored scans."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from register_shapes import best_guess, moved, relief

from cgroup import InputError
from cgroup.fronts.scan import as_surface, mirror_image
from cgroup.registration import FalseAccepts, false_accepts
from cgroup.registration.decoys import count_false_accepts
from cgroup.scenes import false_joins, register_all
from strategies import FloatArray

MIRROR = np.array([-1.0, 1.0, 1.0])


@pytest.mark.parametrize(
    ("count", "low", "high"), [(0, 0.0, 3.689), (1, 0.0253, 5.572), (5, 1.623, 11.668), (20, 12.217, 30.888)]
)
def test_the_interval_is_that_of_a_poisson_count(count: int, low: float, high: float) -> None:
    found = count_false_accepts([True] * 100, [True] * count + [False] * (100 - count))
    assert found.interval == pytest.approx((low / 100, high / 100), rel=0.02, abs=2e-4)
    assert found.share == pytest.approx(count / 100)


@given(st.lists(st.tuples(st.booleans(), st.booleans()), max_size=50))
def test_decoys_are_counted_over_accepted_poses(pairs: list[tuple[bool, bool]]) -> None:
    found = count_false_accepts([one for one, _ in pairs], [decoy for _, decoy in pairs])
    accepted, decoys = (sum(column) for column in zip(*pairs, strict=True)) if pairs else (0, 0)
    assert (found.pairs, found.accepted, found.decoys) == (len(pairs), accepted, decoys)
    if accepted:
        assert 0 <= found.interval[0] <= found.share <= found.interval[1] <= 1
        assert f"of {accepted} accepted poses" in str(found)
        assert ("an unknown number" in str(found)) == (found.interval[1] >= 0.5)
    else:
        assert np.isnan(found.share)
        assert "none" in str(found)


def test_a_mirror_image_is_refused_and_its_decoy_is_not() -> None:
    source, (target, _) = relief(0, rms=5.0, noise=0.02), moved(relief(1, rms=5.0, noise=0.02))
    right, wrong = best_guess(source, target), best_guess(source * MIRROR, target)
    assert right.ok
    assert right.decoy_probability is not None
    assert right.decoy_probability < 0.1
    assert not wrong.ok
    assert wrong.decoy_probability is not None
    assert wrong.decoy_probability > 0.5
    assert false_accepts([right, wrong, None]).decoys == 1
    near = best_guess(source, target, initial=right.T_target_source)
    assert near.decoy_probability is None
    assert false_accepts([near]).pairs == 0


@pytest.mark.parametrize("axis", [None, (0.0, 0.0, -2.0), (1.0, 0.01, 0.0), (0.3, -4.0, 1.0)])
def test_a_mirror_image_keeps_distances_and_the_axis_but_not_handedness(
    axis: tuple[float, float, float] | None,
) -> None:
    points, eye = relief(0, rms=5.0, noise=0.02), (3.0, 2.0, 90.0)
    up = np.array([0.0, 0.0, 1.0] if axis is None else axis)
    image, place = mirror_image(as_surface("cloud", points), eye, None if axis is None else up)
    change = np.linalg.lstsq(points, image.cloud.points, rcond=None)[0].T
    np.testing.assert_allclose(change @ change.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(change) == pytest.approx(-1)
    np.testing.assert_allclose(change @ up, up, atol=1e-9)
    assert place == pytest.approx(change @ eye)
    again, back = mirror_image(image, place, None if axis is None else up)
    np.testing.assert_allclose(again.cloud.points, points, atol=1e-9)
    assert back == pytest.approx(eye)


def joins_of(heights: list[FloatArray]) -> FalseAccepts:
    scans = [moved(points, seed)[0] for seed, points in enumerate(heights)]
    scene = register_all(scans)
    assert [len(part) for part in scene.components] == [len(scans)]
    return false_joins(scene)


def test_mirrored_scans_join_no_scene() -> None:
    found = joins_of([relief(seed, rms=5.0, noise=0.02) for seed in range(3)])
    assert (found.pairs, found.accepted, found.decoys) == (3, 3, 0)


def test_scans_that_are_their_own_mirror_images_join() -> None:
    def symmetric(seed: int) -> FloatArray:
        half = relief(seed, rms=5.0, noise=0.02, count=14_000) + np.array([0.0, 5.0, 0.0])
        return np.concatenate([half, half * MIRROR[[1, 0, 2]]])

    found = joins_of([symmetric(seed) for seed in range(3)])
    assert found.decoys == 3


def test_other_results_are_refused() -> None:
    with pytest.raises(InputError, match="results: got "):
        false_accepts([None, "pose"])  # pyright: ignore[reportArgumentType]
