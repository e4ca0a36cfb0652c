"""Few or flat matches that fit exactly are no chance; unrelated ones are, however few or regular."""

import itertools
from collections.abc import Iterator

import numpy as np
import pytest

import cgroup
from cgroup.rigid import apply
from cgroup.types import FloatArray

SIZES = [4, 5, 6, 7, 8, 10, 12, 16, 30, 80, 200]
SHAPES = {
    "plane": (1.0, 1.0, 0.0),
    "body": (1.0, 1.0, 0.6),
    "line": (1.0, 0.0, 0.0),
    "thin": (1.0, 1.0, 1e-3),
}


def motion(rng: np.random.Generator) -> FloatArray:
    pose = np.eye(4)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    pose[:3, :3] = turn * np.linalg.det(turn)
    pose[:3, 3] = 50.0 * rng.normal(size=3)
    return pose


def off(found: cgroup.Grouping, pose: FloatArray, points: FloatArray) -> float:
    assert found.model is not None
    return float(np.linalg.norm(apply(found.model, points) - apply(pose, points), axis=1).max())


@pytest.mark.parametrize("shape", ["plane", "body", "thin"])
@pytest.mark.parametrize("noise", [1e-6, 1e-4])
@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e4])
def test_exact_matches_are_sure(shape: str, noise: float, unit: float) -> None:
    sure = total = 0
    for seed in range(2):
        for n in SIZES:
            rng = np.random.default_rng(seed)
            points = unit * rng.uniform(0, 1, (n, 3)) * SHAPES[shape]
            pose = motion(rng)
            target = apply(pose, points) + unit * noise * rng.normal(size=(n, 3))
            for known in ({}, {"tolerance": 0.05 * unit}, {"resolution": 0.01 * unit}):
                found = cgroup.lc(points, target, **known)
                total += 1
                sure += bool(found.ok and found.mask.all() and off(found, pose, points) < 50 * unit * noise)
    assert sure >= 0.97 * total


@pytest.mark.parametrize("shape", SHAPES)
def test_unrelated_matches_are_not_sure(shape: str) -> None:
    for seed in range(6):
        for n in SIZES:
            rng = np.random.default_rng(seed)
            points = rng.uniform(0, 1, (n, 3)) * SHAPES[shape]
            others = rng.uniform(0, 1, (n, 3)) * SHAPES[shape]
            for target in (others, np.roll(points, 1, axis=0), points[rng.permutation(n)][::-1]):
                moved = apply(motion(rng), target)
                if (np.all(target == points, axis=1)).sum() > 3:
                    continue  # a permutation that leaves four in place is a rigid motion of these
                for known in ({}, {"tolerance": 0.05}, {"resolution": 0.01}):
                    assert not cgroup.lc(points, moved, **known).ok, (n, seed)


def accidents() -> Iterator[tuple[FloatArray, FloatArray, dict[str, float]]]:
    """Yield matches that fit by accident or fix no pose: three, on a line, mirrored, shuffled on a grid."""
    rng = np.random.default_rng(0)
    for shape, n in (("line", 3), ("line", 50), ("plane", 3), ("body", 3)):
        points = rng.uniform(0, 1, (n, 3)) * SHAPES[shape]
        yield points, apply(motion(rng), points) + 1e-4 * rng.normal(size=(n, 3)), {}
    for thickness, n in ((0.01, 200), (0.05, 50), (0.05, 200)):
        points = rng.uniform(-1, 1, (n, 3)) * [1.0, 1.0, thickness]
        mirrored = points * [1.0, 1.0, -1.0] + 1e-4 * rng.normal(size=(n, 3))
        yield from ((points, mirrored, known) for known in ({}, {"tolerance": 0.05}, {"resolution": 0.02}))
    for side, seed in itertools.product((2, 3, 4, 6), range(12)):
        grid = np.stack(np.meshgrid(range(side), range(side), [0.0]), axis=-1).reshape(-1, 3)
        shuffled = grid[np.random.default_rng(seed).permutation(len(grid))]
        if (np.all(shuffled == grid, axis=1)).sum() < 4:
            yield grid, shuffled, {}


def test_accidental_fits_are_not_sure() -> None:
    for points, target, known in accidents():
        assert not cgroup.lc(points, target, **known).ok


def test_wrong_matches_among_exact_ones_stay_out() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        points, pose = rng.uniform(0, 1, (16, 3)) * SHAPES["plane"], motion(rng)
        target = apply(pose, points)
        target[10:] = apply(pose, rng.uniform(0, 1, (6, 3)) * SHAPES["plane"])
        found = cgroup.lc(points, target)
        assert found.ok
        assert off(found, pose, points) < 0.02
