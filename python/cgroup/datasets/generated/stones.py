"""Data sets without a download: generated stones in the three roles of the paper's data sets.

The stones are those of `standin_pair`: closed, rich in detail, without symmetry. Every pair is made from its
name alone, so the same name is the same pair on every machine.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from cgroup.datasets.base import Dataset, MatchingPair, measure_clutter, measure_overlap, posed_pair
from cgroup.datasets.generated.scanner import Mesh, angular_size, merge, range_image
from cgroup.datasets.generated.shapes import RADIUS, random_direction, random_pose, stone
from cgroup.errors import InputError
from cgroup.evaluation.ground_truth import VISIBLE_WITHIN
from cgroup.rigid import invert
from cgroup.types import FloatArray, PointCloud

_GRID_PER_PIXEL = 1.2  # mesh vertices along each edge of the cube that is blown up to a ball
_DISTANCES = (5.0, 5.6)  # of a pair's two scanners from the centre, in radii

_MODEL_GRID = 70  # 28,000 vertices, 0.8 mm apart

_WANTED, _OTHERS = 4, 1  # the others are in each scene, but not looked for
_SCENE_GRID = 90  # finer than the models, whose vertices must not come back in the scene
_DISTANCE, _LAYER = 20.0, 2.0  # radii: to the nearest stone, from one to the next
_SPREAD = (1.25, 1.05, 0.85)  # radii: how far the stones of each scene lie from the line of sight
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
    """Scan a mesh: one point per pixel, with noise along the line of sight, in the scanner's frame."""
    seen = mesh.move(T_scanner_world)
    step = angular_size(seen) / pixels
    image = range_image(seen, step=step, offset=rng.uniform(1, 2, size=2))
    ranges = image.ranges()
    spacing = step * float(np.median(ranges))
    return PointCloud(image.points(noise * spacing * rng.normal(size=len(ranges))))


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


class _Standin(Dataset):
    """What the three have in common."""

    origin, citation = "synthetic", "generated by cgroup"


class StandinFull(_Standin):
    """Whole stones against posed copies of themselves, for noise and decimation to go on top; unit mm."""

    name, title, role = "standin-full", "Stones, full to full", "full-full"

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


class StandinClutter(_Standin):
    """Whole stones in range scans of heaps of stones; unit mm.

    Each of the scenes holds five stones, four of which are looked for. The scanner is at the origin of the
    scene and looks along -z; the nearer stones partly hide the others, from scene to scene more.
    """

    name, title, role = "standin-clutter", "Stones, full to partial", "full-partial"

    def pair_names(self) -> list[str]:
        """Return ``scene0-stone0`` to ``scene2-stone3``."""
        return [f"scene{scene}-stone{stone}" for scene in range(len(_SPREAD)) for stone in range(_WANTED)]

    def load(self, name: str) -> MatchingPair:
        """Make the stone, and the scene that it is in."""
        model, scene, pose = self._make(name)
        facts = measure_clutter(model, scene, pose, VISIBLE_WITHIN)
        return MatchingPair(name, model, PointCloud(scene.points), pose, normals="mesh", facts=facts)

    def measure_facts(self, name: str, *, bound: float) -> dict[str, float]:
        """Measure clutter and occlusion with another bound."""
        return measure_clutter(*self._make(name), bound)

    def _make(self, name: str) -> tuple[PointCloud, PointCloud, FloatArray]:
        self.check_name(name)
        scene, stone_number = (int(part[5:]) for part in name.split("-"))
        return _model(stone_number), _scene(scene), _heap(scene)[stone_number]


class StandinViews(_Standin):
    """Pairs of range scans of one stone, with less and less overlap; unit mm."""

    name, title, role = "standin-views", "Stones, partial to partial", "partial-partial"
    single_views = True

    def pair_names(self) -> list[str]:
        """Return ``views0``, the one with the most overlap, to ``views11``."""
        return [f"views{number}" for number in range(_VIEWS)]

    def subject_of(self, name: str) -> str:
        """Return the name of the pair: each is of another stone."""
        self.check_name(name)
        return name

    def load(self, name: str) -> MatchingPair:
        """Scan a stone from two sides."""
        self.check_name(name)
        number = int(name.removeprefix("views"))
        turn = float(np.linspace(*_TURNS, _VIEWS)[number])
        made = standin_pair(seed=number, turn=turn, pixels=_VIEW_PIXELS)
        source, target, pose = made.source, made.target, made.T_target_source
        shared = measure_overlap(source, target, pose)
        return MatchingPair(name, source, target, pose, facts={"overlap": shared})


def _model(seed: int) -> PointCloud:
    mesh = stone(np.random.default_rng(seed), _MODEL_GRID)
    # The six sides of the blown-up cube share the vertices on its edges.
    _, first, inverse = np.unique(mesh.vertices.round(3), axis=0, return_index=True, return_inverse=True)
    return PointCloud(mesh.vertices[first], faces=inverse.reshape(-1)[mesh.faces])


def _heap(number: int) -> list[FloatArray]:
    """Poses of the stones in a scene: around the line of sight, each behind the other, in random order."""
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
