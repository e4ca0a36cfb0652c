"""The verdict depends on neither the frame of the clouds, the order of their points, their unit, nor their roles."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest
from register_shapes import best_guess
from shared_data import shared_file
from test_rings import ROOM, spin

from cgroup.datasets import open_dataset, standin_pair
from cgroup.io import read_cloud
from cgroup.rigid import apply, invert
from strategies import random_motion

if TYPE_CHECKING:
    from collections.abc import Callable

    from cgroup.registration import Registration
    from strategies import FloatArray

    Pair = tuple[FloatArray, FloatArray]


def stones() -> Pair:
    pair = standin_pair(pixels=60)
    return pair.source.points, pair.target.points


def unrelated() -> Pair:
    return standin_pair(pixels=60).source.points, standin_pair(seed=1, pixels=60).source.points


def rings() -> Pair:
    """A room seen by 16 beams from two places."""
    return spin(16, 300, 0.01, place=tuple(0.3 * ROOM)), spin(16, 300, 0.01, place=tuple(-0.2 * ROOM))


def walls() -> Pair:
    """Walls without noise, whose normals have no side by themselves."""
    pair = open_dataset("worlds").load("room0")
    return pair.source.points, pair.target.points


def views() -> Pair:
    names = (f"data/stanford_views/happy_stand/happyStandRight_{angle}.ply" for angle in (24, 48))
    source, target = (read_cloud(shared_file(name)).points for name in names)
    return source, target


def vlp16() -> Pair:
    names = (f"data/scenes/vlp16_indoor_11/vlp_{number}.ply" for number in ("08", "10"))
    source, target = (read_cloud(shared_file(name)).points for name in names)
    return source, target


@cache
def as_they_are(pair: Callable[[], Pair]) -> Registration:
    return best_guess(*pair())


def check_the_same(
    found: Registration, pose: FloatArray, pair: Callable[[], Pair], unit: float = 1.0
) -> None:
    """Compare a registration with that of the pair as it is, and its pose in the frames of that one."""
    known = as_they_are(pair)
    assert found.ok == known.ok
    assert found.probability == pytest.approx(known.probability, abs=0.05)
    assert found.voxel == pytest.approx(unit * known.voxel)
    if known.ok and known.open_motion is None:
        moved, still = (apply(T, pair()[0]) for T in (pose, known.T_target_source))
        assert np.linalg.norm(moved - still, axis=1).mean() < 0.05 * known.voxel


@pytest.mark.parametrize("pair", [stones, unrelated, rings, walls, views, vlp16])
def test_clouds_may_lie_anywhere_in_any_order(pair: Callable[[], Pair]) -> None:
    rng = np.random.default_rng(0)
    source, target = pair()
    size = float(np.linalg.norm(np.ptp(source, axis=0)))
    motions = [random_motion(rng, 3 * size) for _ in range(2)]
    given = [rng.permutation(apply(T, points)) for T, points in zip(motions, (source, target), strict=True)]
    found = best_guess(*given)
    check_the_same(found, invert(motions[1]) @ found.T_target_source @ motions[0], pair)


@pytest.mark.parametrize("pair", [stones, unrelated, rings, vlp16])
def test_source_and_target_may_change_places(pair: Callable[[], Pair]) -> None:
    source, target = pair()
    found = best_guess(target, source)
    check_the_same(found, invert(found.T_target_source), pair)


@pytest.mark.parametrize("pair", [stones, unrelated, rings, walls, vlp16])
def test_any_unit_will_do(pair: Callable[[], Pair]) -> None:
    unit = 0.0254
    source, target = (unit * np.asarray(points, dtype=np.float64) for points in pair())
    found = best_guess(source, target)
    pose = found.T_target_source.copy()
    pose[:3, 3] /= unit
    check_the_same(found, pose, pair, unit)
