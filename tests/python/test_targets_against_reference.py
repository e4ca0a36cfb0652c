"""The poses and tests of surveyed targets: the Rust core beside the NumPy reference, on random sites."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cgroup import fit_targets
from reference import targets as reference

SHAPES = {"site": (1, 1, 0.25), "plane": (1, 1, 1e-4), "line": (1, 2e-3, 1e-3), "wall": (1, 1e-3, 0.1)}


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(3, 12) | st.integers(3, 30),
    blunders=st.sampled_from([(), (0.5,), (0.02,), (30.0,), (0.4, -0.6), (0.3, 5.0, -0.4)]),
    shape=st.sampled_from([*SHAPES]),
    unit=st.sampled_from([1.0, 1.0, 1.0, 0.3048, 1.01]),
    is_swapped=st.sampled_from([False, False, False, True]),
    is_utm=st.booleans(),
    sigma=st.sampled_from([None, 0.004, 1e-4, 1.0]),
)
def test_fits_are_those_of_the_reference(seed, count, blunders, shape, unit, is_swapped, is_utm, sigma):
    rng = np.random.default_rng(seed)
    source = rng.uniform(-50, 50, (count, 3)) * SHAPES[shape]
    turn = Rotation.from_rotvec(rng.normal(0, 2, 3)).as_matrix()
    target = source @ turn.T + rng.uniform(-100, 100, 3) + (np.array([5e5, 5.3e6, 300]) if is_utm else 0)
    target += rng.normal(0, 0.004, target.shape)
    for row, size in zip(rng.permutation(count), blunders, strict=False):
        target[row] += size * rng.uniform(0.5, 1, 3)
    source = (source[:, [1, 0, 2]] if is_swapped else source) / unit
    compare(source, target, sigma)


def compare(source: np.ndarray, target: np.ndarray, sigma: float | None) -> None:
    fit = fit_targets(source, target, sigma=sigma)
    used, named, suspects, chance = reference.find_blunders(source, target, sigma)
    np.testing.assert_array_equal(fit.is_used, used)
    np.testing.assert_array_equal(fit.is_blunder, named)
    doubts = reference.doubts(source, target, sigma, used, suspects, chance)
    noted = [note for note in fit.notes if "is a blunder:" not in note]
    assert [note[: len(words)] for note, words in zip(noted, doubts, strict=True)] == doubts
    among = [note.split(" among ")[1] for note in noted if " among " in note]
    assert among == ([", ".join(str(row + 1) for row in np.flatnonzero(suspects))] if suspects.any() else [])
    assert fit.ok == (not doubts)

    poses = reference.fit(source, target, used[None])
    r = 3 * int(used.sum()) - 6
    assert fit.redundancy == r
    extent = np.ptp(target, axis=0).max()
    error = 1e-14 * poses.condition[0] + 1e-12  # of a rotation
    np.testing.assert_allclose(fit.pose[:3, :3], poses.rotations[0], rtol=0, atol=error)
    middle = source[used].mean(axis=0)
    place = poses.rotations[0] @ middle + poses.translations[0]
    size = max(np.abs(source).max(), np.abs(target).max())
    np.testing.assert_allclose(fit.pose[:3, :3] @ middle + fit.pose[:3, 3], place, rtol=0, atol=1e-15 * size)
    np.testing.assert_allclose(fit.residuals, poses.residuals[0], rtol=0, atol=error * extent)
    noise = reference.variance(poses.squares[0], r, sigma, reference.floor(source, target))
    assert fit.sigma == pytest.approx(noise**0.5, rel=1e-9)
    freedom = r + (0 if sigma is None else reference.KNOWN)
    true = reference.covariance(poses.rotations[0], source[used], target[used], noise, freedom)
    scale = np.sqrt(np.outer(np.diag(true), np.diag(true)))
    assert np.abs((fit.covariance - true) / scale).max() < 1e-9 + 1e-15 * poses.condition[0]
    away, condition = reference.leave_one_out(source, target, used)
    assert (np.isnan(fit.leave_one_out) == np.isnan(away)).all()
    difference = np.abs(fit.leave_one_out - away)
    assert (np.isnan(away) | (difference <= 1e-9 * away + 1e-15 * condition * extent)).all()
