"""Levels of clutter, occlusion and overlap."""

import numpy as np

from cgroup.evaluation.protocols import CLUTTER, OCCLUSION, OVERLAP, binned


def test_nearest_level_without_limit_at_the_ends() -> None:
    np.testing.assert_allclose(
        binned([0.1, 0.66, 0.674, 0.676, 0.99], CLUTTER), [0.65, 0.65, 0.65, 0.70, 0.95]
    )
    np.testing.assert_allclose(binned([0.60, 0.9], OCCLUSION), [0.60, 0.90])


def test_from_a_level_up_to_the_next_and_the_last_closed() -> None:
    values = [0.29, 0.3, 0.399, 0.4, 0.7, 0.9, 1.0, 1.01]
    np.testing.assert_allclose(binned(values, OVERLAP), [np.nan, 0.3, 0.3, 0.4, 0.7, 0.9, 0.9, np.nan])


def test_each_level_is_its_own() -> None:
    for bins in (CLUTTER, OCCLUSION, OVERLAP):
        np.testing.assert_array_equal(binned(bins.levels, bins), bins.levels)


def test_unknown_stays_unknown() -> None:
    assert np.isnan(binned([np.nan], CLUTTER)).all()
    assert binned([], OVERLAP).shape == (0,)
