"""Models in scenes: the right ones where they are, and none that are not there."""

import numpy as np
import pytest
from scenes import stone_model, stone_scene
from shared_data import data_folder

from cgroup import InputError
from cgroup.datasets.u3or import U3OR
from cgroup.registration import Registration, find_instances, prepare, recognize
from cgroup.rigid import rotation_error, translation_error
from cgroup.types import PointCloud

EYE = (0.0, 0.0, 0.0)
MODELS = {f"stone {seed}": stone_model(seed) for seed in range(4)}


def mirrored(model: PointCloud) -> PointCloud:
    assert model.faces is not None
    return PointCloud(model.points * (-1, 1, 1), faces=model.faces[:, [0, 2, 1]])


def nearest_pose(found: Registration, poses: list[np.ndarray]) -> int:
    """Which of the poses was found; fails if it is none."""
    errors = [
        (translation_error(found.T_target_source, pose), rotation_error(found.T_target_source, pose))
        for pose in poses
    ]
    row = int(np.argmin([shift for shift, _ in errors]))
    assert errors[row][0] < 0.3 * found.voxel
    assert errors[row][1] < 0.5
    return row


@pytest.fixture(scope="module")
def scene() -> tuple[PointCloud, list[np.ndarray]]:
    return stone_scene([1, 2, 1])


def test_finds_what_is_there_and_nothing_else(scene: tuple[PointCloud, list[np.ndarray]]) -> None:
    cloud, poses = scene
    stages: list[str] = []
    found = recognize(MODELS, cloud, viewpoint=EYE, progress=stages.append)
    assert sorted(name for name, _ in found) == ["stone 1", "stone 1", "stone 2"]
    assert sorted(nearest_pose(one, poses) for _, one in found) == [0, 1, 2]
    for name, one in found:
        assert poses[nearest_pose(one, poses)] is poses[1] or name == "stone 1"
        assert one.ok
        assert one.probability > 0.9
        assert 0.05 < one.fitness < 0.5  # one side of a whole model
        assert one.inlier_rmse < 0.2 * one.voxel
        assert len(one.alternatives) == 0
        assert one.grouping.size >= 3
    assert list(dict.fromkeys(stages)) == list(found[0].registration.seconds)


def test_what_is_prepared_gives_the_same(scene: tuple[PointCloud, list[np.ndarray]]) -> None:
    cloud, _ = scene
    names = ("stone 0", "stone 2")
    ((name, raw),) = recognize({name: MODELS[name] for name in names}, cloud, voxel=3.0, viewpoint=EYE)
    library = {name: prepare(MODELS[name], voxel=3.0, normals="mesh") for name in names}
    target = prepare(cloud, voxel=3.0, viewpoint=EYE)
    for threads in (1, 2):
        ((again, ready),) = recognize(library, target, threads=threads)
        assert name == again == "stone 2"
        np.testing.assert_array_equal(raw.T_target_source, ready.T_target_source)
        assert raw.probability == ready.probability


def test_normals_tell_the_outside_as_faces_do(scene: tuple[PointCloud, list[np.ndarray]]) -> None:
    cloud, poses = scene
    model = MODELS["stone 2"]
    assert model.faces is not None
    _, rows = np.unique(model.points.round(6), axis=0, return_index=True)
    outwards = PointCloud(model.points[rows], normals=model.points[rows])  # the stones are star-shaped
    (found,) = find_instances(outwards, cloud, viewpoint=EYE)
    assert nearest_pose(found, poses) == 1
    inwards = PointCloud(model.points[rows], normals=-model.points[rows])
    assert find_instances(inwards, cloud, viewpoint=EYE) == []


def test_refuses_what_can_not_be_looked_for(scene: tuple[PointCloud, list[np.ndarray]]) -> None:
    cloud, _ = scene
    bare = PointCloud(MODELS["stone 0"].points)
    assert len(find_instances(MODELS["stone 1"], cloud, viewpoint=EYE, most=1)) == 1
    with pytest.raises(InputError, match="models"):
        recognize({}, cloud)
    with pytest.raises(InputError, match="'stone': got neither faces nor normals"):
        recognize({"stone": bare}, cloud, viewpoint=EYE)
    with pytest.raises(InputError, match="without its outside"):
        recognize({"stone": prepare(bare, voxel=3.0)}, cloud, viewpoint=EYE)
    with pytest.raises(InputError, match="same unit"):
        recognize({"stone": PointCloud(1000 * bare.points, faces=MODELS["stone 0"].faces)}, cloud)
    with pytest.raises(InputError, match="got both"):
        prepare(MODELS["stone 0"], normals="mesh", viewpoint=EYE)
    with pytest.raises(InputError, match="no faces"):
        prepare(bare, normals="mesh")


def test_finds_the_four_models_of_a_real_scan() -> None:
    dataset = U3OR(data_folder("u3or"))
    names = ("chef", "chicken", "parasaurolophus", "T-rex")
    scan = PointCloud(dataset.scene(1).points)
    found = dict(recognize({name: dataset.model(name) for name in names}, scan, viewpoint=EYE))
    assert sorted(found) == sorted(names)
    for name, one in found.items():
        truth = dataset.load(f"rs1-{name}").T_target_source
        assert rotation_error(one.T_target_source, truth) < 1.0
    others = {name: mirrored(dataset.model(name)) for name in names}
    assert recognize(others, scan, viewpoint=EYE) == []
