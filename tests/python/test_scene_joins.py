"""A scene joins nothing that its pairs and unions leave open: places that look alike stay apart."""

import numpy as np
import pytest

from cgroup.datasets import standin_pair
from cgroup.errors import NoConsensusError
from cgroup.registration import register
from cgroup.rigid import apply
from cgroup.scenes import register_all
from cgroup.scenes.decide import Decision
from cgroup.scenes.join import propose_joins, weigh_join
from cgroup.scenes.links import Link
from strategies import random_motion


def cone(rng, slope):
    height, angle = np.sqrt(rng.random(20_000)), rng.uniform(0, 2 * np.pi, 20_000)
    points = np.column_stack([height * np.cos(angle), height * np.sin(angle), slope * height])
    return points + 0.004 * rng.normal(size=points.shape)


def room(rng, size):
    """A bare box with eight pieces of furniture at random places."""
    points = []
    for number in range(9):
        sides = np.array(size) if number == 0 else rng.uniform((0.4, 0.4, 0.4), (1.6, 1, 1.8))
        corner = np.append(rng.uniform((0, 0), np.array(size[:2]) - sides[:2]), 0) if number else np.zeros(3)
        for axis in range(3):
            for end in (0, 1):
                face = rng.random((int(100 * np.prod(np.delete(sides, axis))) + 20, 3))
                face[:, axis] = end
                points.append(corner + face * sides)
    return np.concatenate(points)


def look_alikes(kind, seed):
    """Two clouds whose pose nothing tells."""
    rng = np.random.default_rng([seed, *kind.encode()])
    if kind == "cone":
        slope = rng.uniform(1, 3)
        return cone(rng, slope), cone(rng, slope)
    size = rng.uniform((4, 3, 2.4), (8, 6, 3.4))
    one = room(rng, size)
    return one, one * [-1, 1, 1] if kind == "mirrored room" else room(rng, size)


def scan_twice(rng, points):
    """Half of the points and the other half, each in a frame of its own."""
    half = rng.random(len(points)) < 0.5
    return [apply(random_motion(rng, 10.0), part) for part in (points[half], points[~half])]


@pytest.mark.parametrize("kind", ["cone", "room", "mirrored room"])
def test_what_a_pair_leaves_open_stays_apart(kind):
    one, other = look_alikes(kind, 0)
    with pytest.raises(NoConsensusError):
        register(one, other)
    scene = register_all([one, other])
    assert scene.components == [[0], [1]]
    assert scene.edges == []


@pytest.mark.parametrize("kind", ["room", "mirrored room"])
def test_more_scans_of_the_same_do_not_join_it(kind):
    rng = np.random.default_rng(2)
    scans = [scan for place in look_alikes(kind, 2) for scan in scan_twice(rng, place)]
    for part in register_all(scans).components:
        assert len({row // 2 for row in part}) == 1


def test_two_scans_are_as_probable_as_their_pair():
    pair = standin_pair(seed=1, turn=50, pixels=60)
    scene = register_all([pair.target, pair.source])
    (edge,) = scene.edges
    alone = register(pair.source, pair.target, voxel=scene.voxel).probability
    assert edge.probability == scene.probability[1] == pytest.approx(alone)


def link_of(*chances, overlap=0.5):
    poses = np.tile(np.eye(4), (len(chances), 1, 1))
    return Link(poses, np.array(chances), 1e-4 * np.eye(6), overlap, overlap)


def test_two_single_scans_are_no_union():
    links = {(1, 0): link_of(0.3), (2, 0): link_of(0.2), (3, 2): link_of(0.4)}
    decision = Decision(np.tile(np.eye(4), (4, 1, 1)), np.array([0, 0, 2, 3]), {(1, 0): 0.9})
    (join,) = propose_joins(links, decision, np.zeros((4, 3)), 0.1)
    assert {join.source, join.target} == {2, 0}


@pytest.mark.parametrize("pairs", [1, 4, 40])
def test_pairs_across_do_not_make_a_join_more_probable(pairs):
    told = [link_of(0.99)] * pairs
    assert weigh_join(link_of(0.6), [told]) == pytest.approx(0.6)
    assert weigh_join(link_of(0.3, 0.3), [told, told]) == pytest.approx(0.3)
    assert weigh_join(link_of(0.2), [told]) == pytest.approx(0.2)


def test_pairs_across_refute_a_join_and_its_rivals():
    fits, fails = [link_of(0.99)], [link_of(0.01)]
    assert weigh_join(link_of(0.9), [fails]) < 0.6
    assert weigh_join(link_of(0.4, 0.4), [fits, fails]) == pytest.approx(0.8, abs=0.01)
    assert weigh_join(link_of(0.4, 0.4), [fails, fits]) < 0.1
    assert weigh_join(link_of(0.9), [[None, link_of(0.01, overlap=0.1)]]) == pytest.approx(0.9)
