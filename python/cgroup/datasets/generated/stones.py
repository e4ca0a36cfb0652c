"""Stones: balls cut by planes, with bumps and dents at two scales, all placed at random.

The data sets have them in the three roles of the paper's, without a download. Every pair is made from its
name alone, so the same name is the same pair on every machine.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from cgroup.datasets.base import Dataset, MatchingPair, measure_clutter, posed_pair, view_pair, voxel_means
from cgroup.datasets.generated.scanner import Mesh, merge, range_image
from cgroup.errors import InputError
from cgroup.rigid import invert
from cgroup.rigid.transforms import turn
from cgroup.types import FloatArray, IndexArray, PointCloud

RADIUS = 50.0  # mean radius of the shape, in mm
_AXES = (1.0, 0.85, 0.7)  # of the ellipsoid that the details sit on, in radii

_FACETS, _CUT = 150, 0.15  # planes that cut the ball, and the depth of the deepest cut in radii
_TALLEST = 1.1  # radii, without a cutting plane
_STONE_GAP = 1.3  # diameters between the centres of stones around a scene
# Bumps and dents: (how many, sharpness, height in radii); down to 1/e at an angle of sqrt(2 / sharpness).
_BUMPS = ((150, 60.0, 0.06), (500, 300.0, 0.03))


def stone(rng: np.random.Generator, grid: int) -> Mesh:
    """Make a closed, star-shaped mesh of mean radius `RADIUS` mm around the origin, oriented outwards."""
    # The shape depends on the generator alone. The grid is the number of vertices along each edge of the cube
    # that is blown up to the ball. There are 6 grid^2 vertices, those on the edges several times.
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


_GRID_PER_PIXEL = 1.2  # mesh vertices along each edge of the cube that is blown up to a ball
_DISTANCES = (5.0, 5.6)  # of a pair's two scanners from the centre, in radii

_MODEL_GRID = 70  # 28,000 vertices, 0.8 mm apart

_WANTED, _OTHERS = 4, 1  # the others are in each scene, but not looked for
_SCENE_GRID = 90  # finer than the models, whose vertices must not recur in the scene
_DISTANCE, _LAYER = 20.0, 2.0  # radii: to the nearest stone, from one to the next
_SPREAD = (1.25, 1.05, 0.85)  # radii: distance of the stones of each scene from the line of sight
_STEP = 0.75e-3  # angle between two rays, which makes scenes about as dense as models
_SCENE_NOISE = 0.1  # of the range, in units of the point spacing

_VIEWS, _TURNS = 12, (8.0, 85.0)  # degrees between the two views, from the first pair to the last
_VIEW_PIXELS = 140


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
        Pixels along the larger side of the shape, at least 16; two thirds of its square are points.

    Returns
    -------
    MatchingPair
        Unit mm; scanners at the origin of each view, looking along -z, y up. By default the views share 0.8
        to 0.95 of their points (within 4 pr); 5 to 14 % of matches of Harris keypoints by SHOT are correct.

    Examples
    --------
    >>> from cgroup.datasets import standin_pair
    >>> pair = standin_pair(seed=3, pixels=60)
    >>> pair.name, pair.source.points.shape[1], pair.T_target_source.shape
    ('standin-3', 3, (4, 4))
    """
    if not 0 <= turn <= 180:
        raise InputError("turn", turn, "give degrees from 0 to 180")
    if not (np.isfinite(noise) and noise >= 0):
        raise InputError("noise", noise, "give a finite number, 0 or greater")
    if pixels < 16:
        raise InputError("pixels", pixels, "give at least 16")
    rng = np.random.default_rng(seed)
    mesh = stone(rng, round(_GRID_PER_PIXEL * pixels))
    first = _looking_at_center(rng, random_direction(rng), _DISTANCES[0] * RADIUS)
    aside = _tilt(rng, first[:3, :3].T @ (0.0, 0.0, 1.0), np.radians(turn))
    second = _looking_at_center(rng, aside, _DISTANCES[1] * RADIUS)
    source, target = (_scan(mesh, view, pixels, noise, rng) for view in (first, second))
    return MatchingPair(f"standin-{seed}", source, target, second @ invert(first))


def _scan(
    mesh: Mesh, T_scanner_world: FloatArray, pixels: int, noise: float, rng: np.random.Generator
) -> PointCloud:
    seen = mesh.move(T_scanner_world)
    size = np.ptp(seen.vertices[:, :2] / -seen.vertices[:, 2:], axis=0).max()  # on the plane z = -1
    step = float(size) / pixels
    image = range_image(seen, step=step, offset=rng.uniform(1, 2, size=2))
    ranges = image.ranges()
    spacing = step * float(np.median(ranges))
    return PointCloud(image.points(noise * spacing * rng.normal(size=len(ranges))))


def _looking_at_center(rng: np.random.Generator, direction: FloatArray, distance: float) -> FloatArray:
    """Return the transform from world to scanner: along a direction from the origin, with a random roll."""
    side = np.cross(random_direction(rng), direction)
    side /= np.linalg.norm(side)
    transform = np.eye(4)
    transform[:3, :3] = np.stack([side, np.cross(direction, side), direction])
    transform[2, 3] = -distance
    return transform


def _tilt(rng: np.random.Generator, direction: FloatArray, angle: float) -> FloatArray:
    side = np.cross(random_direction(rng), direction)
    side /= np.linalg.norm(side)
    return np.cos(angle) * direction + np.sin(angle) * side


class StandinFull(Dataset):
    """Complete stones and posed copies of them, as input of noise and decimation; unit mm."""

    name, title, role = "standin-full", "Stones, full to full", "full-full"
    origin, citation = "synthetic", "generated by cgroup"

    def pair_names(self) -> list[str]:
        """Return ``stone0`` to ``stone5``."""
        return [f"stone{seed}" for seed in range(6)]

    def load(self, name: str) -> MatchingPair:
        """Make a stone and pose it."""
        self.check_name(name)
        seed = int(name.removeprefix("stone"))
        model = _model(seed)
        pose = random_pose(np.random.default_rng((seed, 1)))
        return posed_pair(name, model, model.transformed(pose), pose, noise=0.0)


class StandinClutter(Dataset):
    """Complete stones in range scans of heaps of stones; unit mm.

    Each scene has five stones, and pairs of four of them. The scanner is at the origin and looks along -z.
    """

    name, title, role = "standin-clutter", "Stones, full to partial", "full-partial"
    origin, citation = "synthetic", "generated by cgroup"

    def pair_names(self) -> list[str]:
        """Return ``scene0-stone0`` to ``scene2-stone3``."""
        return [f"scene{scene}-stone{stone}" for scene in range(len(_SPREAD)) for stone in range(_WANTED)]

    def load(self, name: str) -> MatchingPair:
        """Make the stone and its scene."""
        self.check_name(name)
        number, stone_number = (int(part[5:]) for part in name.split("-"))
        model, scene, pose = _model(stone_number), _scene(number), _heap(number)[stone_number]
        facts = measure_clutter(model, scene, pose)
        return MatchingPair(name, model, PointCloud(scene.points), pose, normals="mesh", facts=facts)


class StandinViews(Dataset):
    """Pairs of range scans of one stone, with decreasing overlap; unit mm."""

    name, title, role = "standin-views", "Stones, partial to partial", "partial-partial"
    origin, citation = "synthetic", "generated by cgroup"
    single_views = own_subjects = True

    def pair_names(self) -> list[str]:
        """Return ``views0``, the one with the most overlap, to ``views11``."""
        return [f"views{number}" for number in range(_VIEWS)]

    def load(self, name: str) -> MatchingPair:
        """Scan a stone from two sides."""
        self.check_name(name)
        number = int(name.removeprefix("views"))
        turn = float(np.linspace(*_TURNS, _VIEWS)[number])
        made = standin_pair(seed=number, turn=turn, pixels=_VIEW_PIXELS)
        return view_pair(name, made.source, made.target, made.T_target_source)


def _model(seed: int) -> PointCloud:
    mesh = stone(np.random.default_rng(seed), _MODEL_GRID)
    # The six sides of the blown-up cube share the vertices on its edges.
    _, first, inverse = np.unique(mesh.vertices.round(3), axis=0, return_index=True, return_inverse=True)
    return PointCloud(mesh.vertices[first], faces=inverse.reshape(-1)[mesh.faces])


def _heap(number: int) -> list[FloatArray]:
    """Return the poses of the stones in a scene: one behind the other along the line of sight."""
    rng = np.random.default_rng((number, 2))
    poses = [random_pose(rng) for _ in range(_WANTED + _OTHERS)]
    places = rng.permutation(len(poses))
    for layer, stone_number in enumerate(rng.permutation(len(poses))):
        angle = 2 * np.pi * (places[layer] + rng.uniform(-0.3, 0.3)) / len(poses)
        aside = _SPREAD[number] * RADIUS * np.array([np.cos(angle), np.sin(angle)])
        poses[stone_number][:3, 3] = [*aside, -RADIUS * (_DISTANCE + _LAYER * layer)]
    return poses


@lru_cache(maxsize=len(_SPREAD))
def _scene(number: int) -> PointCloud:
    """Scan the heap; all pairs of a scene share it."""
    stones = [
        stone(np.random.default_rng(seed), _SCENE_GRID).move(pose) for seed, pose in enumerate(_heap(number))
    ]
    rng = np.random.default_rng((number, 3))
    image = range_image(merge(stones), step=_STEP, offset=rng.uniform(1, 2, size=2))
    ranges = image.ranges()
    noise = _SCENE_NOISE * _STEP * ranges * rng.normal(size=len(ranges))
    return PointCloud(image.points(noise), faces=image.faces())
