"""Placements of an outline on a map seen from above: the Rust core beside the definition."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cgroup import InputError, _core
from cgroup._checks.values import run_options
from reference import placements


@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.tuples(st.integers(1, 90), st.integers(1, 150)),
    counts=st.tuples(st.integers(0, 300), st.integers(0, 300)),
    reach=st.sampled_from([0.4, 5.0, 60.0, 1e5]),
    most=st.integers(0, 60),
)
def test_scores_are_those_of_the_definition(
    seed: int, shape: tuple[int, int], counts: tuple[int, int], reach: float, most: int
) -> None:
    rng = np.random.default_rng(seed)
    grid = rng.integers(0, 3, shape, np.uint8)
    walls, floor = (rng.uniform(-reach, reach, (count, 2)) for count in counts)
    angles = rng.uniform(0, 2 * np.pi, 3)
    turns = np.column_stack([np.cos(angles), np.sin(angles)])
    ends = [np.sort(rng.integers(0, size + 1, (4, 2)), axis=1) for size in shape]
    windows = np.column_stack([rng.integers(0, 3, 4), *ends])
    places = _core.best_placements(grid, walls, floor, turns, windows, run_options(2), 0.7, most)

    def score(turn: int, at: np.ndarray) -> float:
        return placements.score(grid, walls, floor, turns[turn], at, 0.7)

    area = sum((bottom - top) * (right - left) for _, top, bottom, left, right in windows.tolist())
    assert len(places) == min(most, area)
    scores = [score(place[0], place[1:]) for place in places[::9]]
    assert (np.diff(scores) <= 1e-5).all()
    for turn, top, bottom, left, right in windows.tolist():
        if len(places) and bottom > top and right > left:
            at = np.array([rng.integers(top, bottom), rng.integers(left, right)])
            is_listed = (places == (turn, *at)).all(axis=1).any()
            assert is_listed or score(turn, at) <= score(places[-1, 0], places[-1, 1:]) + 1e-5


def test_windows_beyond_the_map_are_refused() -> None:
    grid, points, turns = np.zeros((4, 5), np.uint8), np.zeros((3, 2)), np.array([[1.0, 0.0]])
    window = np.array([[0, 0, 5, 0, 5]])
    with pytest.raises(InputError, match="windows"):
        _core.best_placements(grid, points, points, turns, window, run_options(1), 0.7, 3)
