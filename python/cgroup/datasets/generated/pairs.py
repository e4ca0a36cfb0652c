"""A pair of range scans without a download: two views of a generated stone.

Each view is what a range scanner sees of it: one point per pixel, none where the surface hides itself or is
seen too obliquely, noise along the line of sight.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cgroup.datasets.base import MatchingPair
from cgroup.datasets.generated.scanner import Mesh, angular_size, range_image
from cgroup.datasets.generated.shapes import RADIUS, random_direction, stone
from cgroup.errors import InputError
from cgroup.rigid import invert
from cgroup.types import PointCloud

if TYPE_CHECKING:
    from cgroup.types import FloatArray

_GRID_PER_PIXEL = 1.2  # mesh vertices along each edge of the cube that is blown up to a ball
_DISTANCES = (5.0, 5.6)  # of the two scanners from the centre, in radii


def standin_pair(*, seed: int = 0, turn: float = 35.0, noise: float = 0.1, pixels: int = 170) -> MatchingPair:
    """Make two partial, noisy views of a generated closed shape, with their pose.

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

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> pair = standin_pair(seed=3, pixels=60)
    >>> pair.name, pair.source.points.shape[1], pair.T_target_source.shape
    ('standin-3', 3, (4, 4))
    """
    _check(turn=turn, noise=noise, pixels=pixels)
    rng = np.random.default_rng(seed)
    mesh = stone(rng, round(_GRID_PER_PIXEL * pixels))
    first = _looking_at_center(rng, random_direction(rng), _DISTANCES[0] * RADIUS)
    aside = _tilt(rng, first[:3, :3].T @ (0.0, 0.0, 1.0), np.radians(turn))
    second = _looking_at_center(rng, aside, _DISTANCES[1] * RADIUS)
    source, target = (_scan(mesh, view, pixels, noise, rng) for view in (first, second))
    return MatchingPair(f"standin-{seed}", source, target, second @ invert(first))


def _check(*, turn: float, noise: float, pixels: int) -> None:
    if not 0 <= turn <= 180:
        raise InputError("turn", turn, "give degrees from 0 to 180")
    if not (np.isfinite(noise) and noise >= 0):
        raise InputError("noise", noise, "give a finite number, 0 or greater")
    if pixels < 16:
        raise InputError("pixels", pixels, "give at least 16")


def _scan(
    mesh: Mesh, T_scanner_world: FloatArray, pixels: int, noise: float, rng: np.random.Generator
) -> PointCloud:
    """Points that a range scanner sees, in its own frame."""
    seen = mesh.move(T_scanner_world)
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


def _tilt(rng: np.random.Generator, direction: FloatArray, angle: float) -> FloatArray:
    """Tilt the direction by an angle towards a random side."""
    side = np.cross(random_direction(rng), direction)
    side /= np.linalg.norm(side)
    return np.cos(angle) * direction + np.sin(angle) * side
