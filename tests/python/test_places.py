"""Where points come to lie: against the reference, in plain cases, and on bad input."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cgroup import InputError
from cgroup.rigid import apply
from cgroup.verification import Place, Surface, places
from reference import places as reference
from reference import verification
from strategies import random_motion


def grid(z: float = 0.0, size: int = 21) -> np.ndarray:
    """A square of points one unit apart, around the z axis."""
    steps = np.arange(size) - (size - 1) / 2
    x, y = np.meshgrid(steps, steps, indexing="ij")
    return np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=1)


UP = np.tile([0.0, 0.0, 1.0], (441, 1))
EYE = (0.0, 0.0, 100.0)


def moved(*shift: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = shift
    return pose


def compare(seed: int, view: str, unit: float, offset: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of random points by the core and by the reference, and what the latter is in doubt of."""
    rng = np.random.default_rng(seed)
    motion = random_motion(rng, offset * unit)
    clouds = []
    for place in (np.eye(4), motion):
        points = rng.uniform(-10, 10, size=(int(rng.integers(30, 120)), 3)) * (1, 1, 0.3)
        normals = rng.normal(size=points.shape) * (0.3, 0.3, 1)
        normals[rng.uniform(size=len(normals)) < 0.1] = np.nan
        clouds.append((apply(place, points * unit), normals @ place[:3, :3].T))
    options: list[dict[str, Any]] = [{"unit": unit, "oriented": view != "none"} for _ in clouds]
    if view == "viewpoint":
        options[1]["viewpoint"] = apply(motion, np.array([[1.0, 2.0, 40.0]]) * unit)[0]
    pose = motion.copy()
    pose[:3, 3] += rng.normal(size=3) * 3 * unit
    (one, other), (option, other_option) = clouds, options
    exact = verification.surface(*one, **option), verification.surface(*other, **other_option)
    core = Surface(*one, **option), Surface(*other, **other_option)
    return places(*core, pose), *reference.places(*exact, pose)


@given(
    seed=st.integers(0, 2**32 - 1),
    view=st.sampled_from(["none", "oriented", "viewpoint"]),
    unit=st.sampled_from([1e-3, 1.0, 250.0]),
    offset=st.sampled_from([0.0, 1e3]),
)
def test_places_are_those_of_the_reference(seed: int, view: str, unit: float, offset: float) -> None:
    found, expected, doubt = compare(seed, view, unit, offset)
    np.testing.assert_array_equal(found[~doubt], expected[~doubt])


def test_the_reference_is_seldom_in_doubt() -> None:
    all_places, doubts = set(), []
    for seed in range(20):
        found, _, doubt = compare(seed, "viewpoint", 1.0, 0.0)
        all_places |= set(found[~doubt].tolist())
        doubts.append(doubt.mean())
    assert np.median(doubts) < 0.2
    assert all_places == {place.value for place in Place}


def test_each_place_is_told() -> None:
    sheet = Surface(grid(), UP, unit=1.0, oriented=True)
    wall = Surface(grid(), UP, unit=1.0, viewpoint=EYE)
    assert set(places(sheet, wall, moved(0, 0, 0))) == {Place.ON}
    assert set(places(sheet, wall, moved(0, 0, 2.5))) == {Place.OFF}
    assert set(places(sheet, wall, moved(0, 0, 20))) == {Place.IN_FRONT}
    assert set(places(sheet, wall, moved(0, 0, -20))) <= {Place.UNKNOWN, Place.BACKGROUND}
    assert set(places(sheet, wall, moved(60, 0, 0))) == {Place.BACKGROUND}
    assert set(places(sheet, sheet, moved(0, 0, 20))) == {Place.UNKNOWN}


def test_refuses_bad_input() -> None:
    sheet, other = (Surface(grid(), UP, unit=unit) for unit in (1.0, 0.5))
    with pytest.raises(InputError, match="unit"):
        places(sheet, other, np.eye(4))
