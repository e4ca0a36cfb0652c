"""A pair of range scans that needs no download: two views of a generated closed shape.

The shape is a stone: a ball cut by planes, with bumps and dents at two scales, all strewn at random:
rich in local detail and without symmetry. Each view is what a range scanner sees of it: one point per
pixel, none where the surface hides itself or is seen too obliquely, noise along the line of sight.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.datasets.base import MatchingPair
from cgroup.datasets.generated.scanner import Mesh, angular_size, range_image
from cgroup.errors import InputError
from cgroup.io import PointCloud

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cgroup.types import FloatArray, IndexArray

RADIUS = 50.0
"""Mean radius of the shape, in mm."""

_AXES = (1.0, 0.85, 0.7)  # of the ellipsoid that the details sit on, in radii
_GRID_PER_PIXEL = 1.2  # mesh vertices along each edge of the cube that is blown up to a ball
_DISTANCES = (5.0, 5.6)  # of the two scanners from the centre, in radii

_FACETS, _CUT = 150, 0.15  # planes that cut the ball, and the depth of the deepest cut in radii
_TALLEST = 1.1  # radii, of what no plane cuts off
# Bumps and dents: (how many, sharpness, height in radii); down to 1/e at an angle of sqrt(2 / sharpness).
_BUMPS = ((150, 60.0, 0.06), (500, 300.0, 0.03))


def standin_pair(*, seed: int = 0, turn: float = 35.0, noise: float = 0.1, pixels: int = 170) -> MatchingPair:
    """Two partial, noisy views of a generated closed shape, with their pose.

    Parameters
    ----------
    seed : int
        Another seed, another shape. The same arguments give the same pair.
    turn : float
        Degrees between the two viewing directions, 0 to 180; the more, the less overlap.
    noise : float
        Standard deviation of the noise along the line of sight, in units of the point spacing.
    pixels : int
        Pixels along the larger side of the shape, at least 16; a view has about two thirds of the
        square of that in points.

    Returns
    -------
    MatchingPair
        Unit mm. Each view is in its scanner's frame: scanner at the origin, looking along -z, y up.
        With the default arguments the views share 0.8 to 0.95 of their points (within 4 pr), and 5 to 14 %
        of the matches of Harris keypoints by SHOT are correct, depending on the seed.

    Raises
    ------
    InputError
        If an argument is out of range.
    """
    _check(turn=turn, noise=noise, pixels=pixels)
    rng = np.random.default_rng(seed)
    mesh = stone(rng, round(_GRID_PER_PIXEL * pixels))
    first = _looking_at_center(rng, random_direction(rng), _DISTANCES[0] * RADIUS)
    aside = _turned(rng, first[:3, :3].T @ (0.0, 0.0, 1.0), np.radians(turn))
    second = _looking_at_center(rng, aside, _DISTANCES[1] * RADIUS)
    source, target = (_scan(mesh, view, pixels, noise, rng) for view in (first, second))
    return MatchingPair(f"standin-{seed}", source, target, second @ np.linalg.inv(first))


def _check(*, turn: float, noise: float, pixels: int) -> None:
    if not 0 <= turn <= 180:
        message = f"turn: got {turn}; give degrees from 0 to 180"
        raise InputError(message)
    if not (np.isfinite(noise) and noise >= 0):
        message = f"noise: got {noise}; give a finite number, 0 or greater"
        raise InputError(message)
    if pixels < 16:
        message = f"pixels: got {pixels}; give at least 16"
        raise InputError(message)


def stone(rng: np.random.Generator, grid: int) -> Mesh:
    """Make a closed, star-shaped mesh of mean radius `RADIUS` around the origin, wound outwards.

    Parameters
    ----------
    rng : numpy.random.Generator
        Another state, another shape; the grid doesn't change it.
    grid : int
        Vertices along each edge of the cube that is blown up to the ball; there are 6 grid^2 vertices, those
        on the edges several times.

    Returns
    -------
    Mesh
        In mm.
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


def _cosines(columns: NDArray[np.float32], direction: NDArray[np.float32]) -> NDArray[np.float32]:
    """Dot products: the same bits on every machine, and no threads that BLAS would start for each."""
    x, y, z = columns
    return x * direction[0] + y * direction[1] + z * direction[2]


def _ball(grid: int) -> tuple[NDArray[np.float32], IndexArray]:
    """Spread unit vectors over the six faces of a blown-up cube, and triangles between them."""
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


def _scan(
    mesh: Mesh, T_scanner_world: FloatArray, pixels: int, noise: float, rng: np.random.Generator
) -> PointCloud:
    """Points that a range scanner sees, in its own frame."""
    seen = mesh.moved(T_scanner_world)
    step = angular_size(seen) / pixels
    image = range_image(seen, step=step, offset=rng.uniform(1, 2, size=2))
    ranges = image.ranges()
    spacing = step * float(np.median(ranges))
    noisy = ranges + noise * spacing * rng.normal(size=len(ranges))
    return PointCloud(image.rays() * noisy[:, None])


def _looking_at_center(rng: np.random.Generator, direction: FloatArray, distance: float) -> FloatArray:
    """World to scanner: placed along a direction from the origin, rolled at random."""
    side = np.cross(random_direction(rng), direction)
    side /= np.linalg.norm(side)
    transform = np.eye(4)
    transform[:3, :3] = np.stack([side, np.cross(direction, side), direction])
    transform[2, 3] = -distance
    return transform


def _turned(rng: np.random.Generator, direction: FloatArray, angle: float) -> FloatArray:
    """Tilt the direction by an angle towards a random side."""
    side = np.cross(random_direction(rng), direction)
    side /= np.linalg.norm(side)
    return np.cos(angle) * direction + np.sin(angle) * side


def _random_directions(rng: np.random.Generator, count: int) -> NDArray[np.float32]:
    vectors = rng.normal(size=(count, 3)).astype(np.float32)
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def random_direction(rng: np.random.Generator) -> FloatArray:
    """Draw a unit vector, all directions alike."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)
