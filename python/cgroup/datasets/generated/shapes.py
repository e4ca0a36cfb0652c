"""Stones: balls cut by planes, with bumps and dents at two scales, all placed at random."""

import numpy as np
from numpy.typing import NDArray

from cgroup.datasets.generated.scanner import Mesh
from cgroup.datasets.voxels import voxel_means
from cgroup.rigid.transforms import turn
from cgroup.types import FloatArray, IndexArray

RADIUS = 50.0  # mean radius of the shape, in mm
_AXES = (1.0, 0.85, 0.7)  # of the ellipsoid that the details sit on, in radii

_FACETS, _CUT = 150, 0.15  # planes that cut the ball, and the depth of the deepest cut in radii
_TALLEST = 1.1  # radii, without a cutting plane
_STONE_GAP = 1.3  # diameters between the centres of stones around a scene
# Bumps and dents: (how many, sharpness, height in radii); down to 1/e at an angle of sqrt(2 / sharpness).
_BUMPS = ((150, 60.0, 0.06), (500, 300.0, 0.03))


def stone(rng: np.random.Generator, grid: int) -> Mesh:
    """Make a closed, star-shaped mesh of mean radius `RADIUS` mm around the origin, oriented outwards.

    The shape depends on the generator alone. The grid is the number of vertices along each edge of the cube
    that is blown up to the ball. There are 6 grid^2 vertices, those on the edges several times.
    """
    directions, faces = _ball(grid)
    columns = np.ascontiguousarray(directions.T)
    height = np.full(len(directions), _TALLEST, dtype=np.float32)
    for normal in _random_directions(rng, _FACETS):
        distance = np.float32(1 - _CUT * rng.uniform())
        height = np.minimum(height, distance / np.maximum(_cosines(columns, normal), np.float32(0.01)))
    for count, sharpness, amplitude in _BUMPS:
        centers = _random_directions(rng, count)
        heights = amplitude * rng.uniform(0.5, 1, size=count) * rng.choice((-1, 1), size=count)
        for center, bump in zip(centers, heights, strict=True):
            cosines = _cosines(columns, center)
            near = np.flatnonzero(cosines > 1 - 10 / sharpness)  # elsewhere it is below bump / 20000
            height[near] += bump * np.exp(sharpness * (cosines[near] - 1))
    return Mesh(RADIUS * height[:, None].astype(np.float64) * directions * _AXES, faces)


def stones_around(
    count: int, scene: FloatArray, size: float, spacing: float, rng: np.random.Generator
) -> FloatArray:
    """Return points on stones that surround a scene without touching it."""
    apart = _STONE_GAP * max(size, float(np.ptp(scene, axis=0).max()))
    middle = (scene.max(axis=0) + scene.min(axis=0)) / 2
    steps = np.arange(-4.0, 5.0)  # of a cubic lattice around the scene, nearest positions first
    places = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    shapes: list[FloatArray] = [np.empty((0, 3))]
    for place in places[np.argsort(np.linalg.norm(places, axis=1), kind="stable")][1:]:
        if count <= sum(len(shape) for shape in shapes):
            break
        vertices = stone(rng, max(8, round(size / (2 * spacing)))).vertices
        shape = vertices * (size / np.ptp(vertices, axis=0).max())
        shapes.append(voxel_means(shape, spacing) + middle + apart * place)
    return np.concatenate(shapes)[:count]


def random_direction(rng: np.random.Generator) -> FloatArray:
    """Draw a uniformly distributed unit vector."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def random_pose(rng: np.random.Generator) -> FloatArray:
    """Draw a pose: a uniform rotation, and a translation of a few radii."""
    quaternion = rng.normal(size=4)
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    pose = np.eye(4)
    pose[:3, :3] = turn(x, y, z, w)
    pose[:3, 3] = 3 * RADIUS * random_direction(rng)
    return pose


def _cosines(columns: NDArray[np.float32], direction: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return dot products, identical to the bit on every machine, without BLAS threads."""
    x, y, z = columns
    return x * direction[0] + y * direction[1] + z * direction[2]


def _ball(grid: int) -> tuple[NDArray[np.float32], IndexArray]:
    """Return unit vectors on a grid over the six faces of a cube, and the triangles between them."""
    steps = np.tan(np.linspace(-np.pi / 4, np.pi / 4, grid))  # nearly even on the ball
    a, b = (part.reshape(-1) for part in np.meshgrid(steps, steps, indexing="ij"))
    one = np.ones_like(a)
    sides = [(a, b, one), (b, a, -one), (b, one, a), (a, -one, b), (one, a, b), (-one, b, a)]
    directions = np.concatenate([np.stack(side, axis=1) for side in sides]).astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    corner = (np.arange(grid - 1)[:, None] * grid + np.arange(grid - 1)).reshape(-1)
    low = np.stack([corner, corner + grid, corner + 1], axis=1)
    high = np.stack([corner + 1, corner + grid, corner + grid + 1], axis=1)
    one_side = np.concatenate([low, high])
    return directions, np.concatenate([one_side + side * grid**2 for side in range(6)])


def _random_directions(rng: np.random.Generator, count: int) -> NDArray[np.float32]:
    vectors = rng.normal(size=(count, 3)).astype(np.float32)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
