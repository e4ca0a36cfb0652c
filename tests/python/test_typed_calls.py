"""What works passes the type hints: `make types` checks the calls of this file, and the tests run them."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import cgroup
from cgroup import Correspondences
from cgroup.datasets import standin_pair
from cgroup.registration import describe, prepare, recognize, register_many
from cgroup.types import AnyCloud

PAIR = standin_pair(pixels=60)
POINTS = PAIR.source.points


class Cloud:
    """One of Open3D or PyVista."""

    def __init__(self) -> None:
        self.points = POINTS


class Mesh:
    """One of trimesh or Open3D."""

    def __init__(self) -> None:
        self.vertices, self.faces = POINTS, np.array([[0, 1, 2]])


class TensorCloud:
    """One of Open3D's tensors."""

    def __init__(self) -> None:
        self.point: dict[str, Any] = {"positions": POINTS}


def test_clouds_in_any_form(tmp_path: Path) -> None:
    file = tmp_path / "cloud.ply"
    cgroup.write_cloud(file, POINTS)
    clouds: list[AnyCloud] = [
        Cloud(),
        Mesh(),
        TensorCloud(),
        POINTS,
        POINTS.tolist(),
        file,
        str(file),
        PAIR.source,
    ]
    for cloud in clouds:
        assert len(cgroup.features.Cloud(cloud)) == len(POINTS)
        assert len(Correspondences(cloud, cloud)) == len(POINTS)
    assert len(prepare(Cloud(), voxel=6.0)) == len(prepare(file, voxel=6.0))
    assert cgroup.gc(Cloud(), Mesh(), tolerance=1.0).size > 0


def test_viewpoints_in_any_form() -> None:
    places: list[ArrayLike] = [(0, 0, 0), [0.0, 0.0, 0.0], np.zeros(3)]
    for place in places:
        assert cgroup.features.normals(POINTS, viewpoint=place).shape == POINTS.shape
        assert prepare(POINTS, voxel=6.0, viewpoint=place).viewpoint == (0, 0, 0)
        assert len(describe(POINTS, viewpoint=place)) > 0
    assert cgroup.register(Cloud(), PAIR.target, source_viewpoint=np.zeros(3), target_viewpoint=[0, 0, 0]).ok
    assert register_many([Cloud(), PAIR.target], viewpoints=[np.zeros(3), None])[0] is not None
    assert recognize({"stone": Cloud()}, PAIR.target)[0].name == "stone"
