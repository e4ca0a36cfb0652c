"""Clouds to be registered, drawn from shapes whose symmetries are known."""

from typing import Any

import numpy as np

from cgroup.errors import NoConsensusError
from cgroup.registration import Registration, register
from cgroup.rigid import apply
from strategies import FloatArray, random_motion


def plane(seed: int, count: int = 12_000, noise: float = 5e-4) -> FloatArray:
    """A square with edges of length 1."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(size=(count, 2)), noise * rng.normal(size=count)])


def relief(seed: int, rms: float, noise: float, count: int = 28_000) -> FloatArray:
    """A sheet of 100 x 70 with sixty bumps, the same for each seed: 10 seeds share one sheet."""
    shape, rng = np.random.default_rng(seed // 10), np.random.default_rng(seed)
    flat, height = rng.uniform((0, 0), (100, 70), size=(count, 2)), np.zeros(count)
    for _ in range(60):
        middle, width = shape.uniform((0, 0), (100, 70)), shape.uniform(2, 8)
        height += shape.uniform(-1, 1) * np.exp(-((flat - middle) ** 2).sum(axis=1) / 2 / width**2)
    return np.column_stack([flat, rms * height / height.std()]) + noise * rng.normal(size=(count, 3))


def torus(seed: int, count: int = 12_000) -> FloatArray:
    """A ring of radius 1 and thickness 0.8 around the z axis."""
    rng = np.random.default_rng(seed)
    around, about = rng.uniform(0, 2 * np.pi, size=(2, count))
    away = 1 + 0.4 * np.cos(about)
    return np.column_stack([away * np.cos(around), away * np.sin(around), 0.4 * np.sin(about)])


def cylinder(seed: int, count: int = 12_000) -> FloatArray:
    """A pipe of radius 1 and length 4 around the z axis."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi, size=count)
    return np.column_stack([np.cos(angle), np.sin(angle), rng.uniform(-2, 2, size=count)])


def sphere(seed: int, count: int = 12_000) -> FloatArray:
    """A ball's surface of radius 1."""
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def cube(seed: int, count: int = 12_000) -> FloatArray:
    """A cube's surface with edges of length 2: 24 rotations map it onto itself."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, size=(count, 3))
    points[np.arange(count), rng.integers(0, 3, size=count)] = rng.choice([-1, 1], size=count)
    return points


def arrow(seed: int, count: int = 12_000) -> FloatArray:
    """A triangular prism along z that only half a turn about x maps onto itself."""
    rng = np.random.default_rng(seed)
    corners = np.array([[1.5, 0.0], [-0.5, 0.6], [-0.5, -0.6]])
    sides = [np.linalg.norm(corners[k] - corners[k - 1]) for k in range(3)]
    side = rng.choice(3, size=count, p=np.array(sides) / sum(sides))
    along = rng.uniform(size=(count, 1))
    points = np.empty((count, 3))
    points[:, :2] = along * corners[side] + (1 - along) * corners[side - 1]
    points[:, 2] = rng.uniform(-0.4, 0.4, size=count)
    ends = np.flatnonzero(rng.uniform(size=count) < 0.4)
    weights = rng.dirichlet([1, 1, 1], size=len(ends))
    points[ends, :2] = weights @ corners
    points[ends, 2] = rng.choice([-0.4, 0.4], size=len(ends))
    return points


def moved(points: FloatArray, seed: int = 0, distance: float = 3.0) -> tuple[FloatArray, FloatArray]:
    """The cloud after a random motion, and the motion."""
    motion = random_motion(np.random.default_rng(seed), distance)
    return apply(motion, points), motion


def best_guess(source: FloatArray, target: FloatArray, **options: Any) -> Registration:
    """The pose that `register` finds, whether it is reliable or not."""
    try:
        return register(source, target, **options)
    except NoConsensusError as error:
        if error.registration is None:
            raise
        return error.registration
