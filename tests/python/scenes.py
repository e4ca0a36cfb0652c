"""Generated scenes for recognition: stones on a floor, seen by the scanner in software."""

from collections.abc import Sequence

import numpy as np

from cgroup.datasets.generated.scanner import Mesh, merge, range_image
from cgroup.datasets.generated.stones import RADIUS, random_pose, stone
from cgroup.types import FloatArray, PointCloud

_DISTANCE = 20 * RADIUS
_STEP = 1.2e-3


def stone_model(seed: int) -> PointCloud:
    """A whole stone, as a mesh."""
    mesh = stone(np.random.default_rng(seed), 60)
    return PointCloud(mesh.vertices, faces=mesh.faces)


def stone_scene(seeds: Sequence[int], *, noise: float = 0.1) -> tuple[PointCloud, list[FloatArray]]:
    """Stones side by side on a floor, as a scanner at the origin sees them, and their poses.

    The floor leans towards the scanner. Noise along the line of sight is in units of the pixels' distance.
    """
    rng = np.random.default_rng([*seeds, 7])
    poses = []
    for number in range(len(seeds)):
        pose = random_pose(rng)
        aside = (number - (len(seeds) - 1) / 2) * 2.6 * RADIUS
        pose[:3, 3] = [aside, 0.0, -_DISTANCE]
        poses.append(pose)
    stones = [
        stone(np.random.default_rng(seed), 90).move(pose) for seed, pose in zip(seeds, poses, strict=True)
    ]
    image = range_image(merge([*stones, _floor(len(seeds))]), step=_STEP, offset=np.array([1.5, 1.5]))
    ranges = image.ranges()
    ranges = ranges + noise * _STEP * ranges * rng.normal(size=len(ranges))
    return PointCloud(image.rays() * ranges[:, None]), poses


def _floor(stones: int) -> Mesh:
    wide, deep = (1.3 * stones + 1) * RADIUS, 2.5 * RADIUS
    x, y = np.meshgrid(np.linspace(-wide, wide, 40), np.linspace(-deep, deep, 40), indexing="ij")
    vertices = np.stack([x, y - 0.5 * RADIUS, 0.6 * y - _DISTANCE - 1.2 * RADIUS], axis=-1).reshape(-1, 3)
    corner = (np.arange(39)[:, None] * 40 + np.arange(39)).reshape(-1)
    low = np.stack([corner, corner + 40, corner + 1], axis=1)
    high = np.stack([corner + 1, corner + 40, corner + 41], axis=1)
    return Mesh(vertices, np.concatenate([low, high]))
