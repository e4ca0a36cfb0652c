"""Generated worlds: rays by hand, exact poses, and what `register` says where places repeat."""

import contextlib

import numpy as np
import pytest

from cgroup.datasets import open_dataset
from cgroup.datasets.generated.worlds import World
from cgroup.errors import NoConsensusError
from cgroup.registration import register
from cgroup.rigid import apply

REPEATING = ("facade", "racks", "corridor", "gear")
WORLDS = {
    kind: open_dataset(name) for name in ("worlds", "worlds-repeating") for kind in open_dataset(name).kinds
}


def ranges(directions: list[tuple[float, float, float]], **things: list[list[float]]) -> list[float]:
    shapes = {"boxes": 7, "cylinders": 5, "balls": 4}
    world = World(**{name: np.reshape(things.get(name, []), (-1, width)) for name, width in shapes.items()})
    return world.cast(np.zeros(3), np.array(directions, float)).tolist()


def test_rays_end_on_the_nearest_thing() -> None:
    x, y, z = (1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)
    assert ranges([x, y, (-1, 0, 0)], boxes=[[5, 0, 0, 1, 2, 3, 0]]) == [4, np.inf, np.inf]
    assert ranges([x], boxes=[[5, 0, 0, 1, 2, 3, np.pi / 2]]) == pytest.approx([3])
    assert ranges([x, z], cylinders=[[4, 0, -1, 1, 0.5]]) == [3.5, np.inf]
    assert ranges([z, (0.6, 0, 0.8)], cylinders=[[0, 0, -9, -1, 2], [0, 0, 2, 3, 1]]) == [2, np.inf]
    assert ranges([y, x], balls=[[0, 9, 0, 2]]) == [7, np.inf]
    assert ranges([x], boxes=[[5, 0, 0, 1, 2, 3, 0]], balls=[[3, 0, 0, 1]]) == [2]


@pytest.mark.parametrize("kind", WORLDS)
def test_scans_of_a_world_overlap_and_are_refused_where_places_repeat(kind: str) -> None:
    """Of three pairs, one may show the end of what repeats."""
    made = [WORLDS[kind].load(f"{kind}{number}") for number in range(3)]
    best = max(made, key=lambda one: one.facts["overlap"])
    assert best.facts["overlap"] > 0.25
    moved = apply(best.T_target_source, best.source.points[::50])
    nearest = np.linalg.norm(moved[:, None] - best.target.points[::7], axis=2).min(axis=1)
    assert np.median(nearest) < 0.05 * np.ptp(best.target.points, axis=0).max()
    accepted = 0
    for pair in made if kind in REPEATING else []:
        eyes = {"source_viewpoint": pair.source_viewpoint, "target_viewpoint": pair.target_viewpoint}
        with contextlib.suppress(NoConsensusError):
            accepted += register(pair.source, pair.target, **eyes).ok
    assert accepted <= 1
