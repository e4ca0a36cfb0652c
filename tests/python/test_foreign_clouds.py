"""Clouds of other libraries go in wherever arrays of points do, with their normals and faces."""

from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, Mock

import numpy as np
import pytest
from foreign_clouds import Frame, Tensor, Vector, real_clouds, stand_ins
from matplotlib import pyplot as plt
from public_calls import PAIR, PROBLEM, VOXEL

import cgroup
from cgroup import evaluation, features, io, nuisances
from cgroup.datasets.generated.stones import StandinClutter
from cgroup.errors import InputError
from cgroup.plots import keypoints_figure, registration_figure
from cgroup.registration import describe, prepare, recognize, register, register_many
from cgroup.registration.scan import as_scan
from cgroup.types import PointCloud, find_cloud
from cgroup.verification import Surface

POINTS = np.random.default_rng(0).normal(size=(60, 3)).astype(np.float32).astype(np.float64)
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
FACES = np.arange(60).reshape(20, 3)
STAND_INS = stand_ins(POINTS, NORMALS, FACES)
REAL = real_clouds(POINTS, NORMALS, FACES)

WITH_NORMALS = {
    "Open3D cloud with normals",
    "Open3D tensors",
    "PyVista with normals",
    "pandas with normals",
    "PCL's names",
}
WITH_FACES = {"Open3D mesh", "Open3D mesh of tensors", "trimesh", "PyVista"}
TOLERANCE = {"brain floats": 0.02}


@pytest.mark.parametrize("kind", STAND_INS)
def test_points_are_those_of_the_cloud(kind: str) -> None:
    np.testing.assert_allclose(features.Cloud(STAND_INS[kind]).points, POINTS, atol=TOLERANCE.get(kind, 0))


@pytest.mark.parametrize("kind", STAND_INS)
def test_scans_have_the_normals_and_faces_of_the_cloud(kind: str) -> None:
    scan = as_scan("cloud", STAND_INS[kind])
    assert (scan.normals is not None) == (kind in WITH_NORMALS)
    assert (scan.faces is not None) == (kind in WITH_FACES)
    if scan.normals is not None:
        np.testing.assert_array_equal(scan.normals, NORMALS)
    if scan.faces is not None:
        np.testing.assert_array_equal(scan.faces, FACES)


def make(kind: str) -> Any:
    try:
        return REAL[kind]()
    except ImportError as error:
        pytest.skip(f"{error.name} is not installed; install it to try its clouds")


@pytest.mark.parametrize("kind", REAL)
@pytest.mark.filterwarnings("default")
def test_the_libraries_own_clouds(kind: str) -> None:
    cloud = make(kind)
    atol = 0.02 if "brain" in kind else 1e-6  # Open3D's tensors are float32
    np.testing.assert_allclose(features.Cloud(cloud).points, POINTS, atol=atol)
    scan = as_scan("cloud", cloud)
    assert (scan.faces is not None) == (kind in WITH_FACES)
    assert (scan.normals is not None) == (kind in {"Open3D cloud", "Open3D tensors"})
    if scan.normals is not None:
        np.testing.assert_allclose(scan.normals, NORMALS, atol=1e-6)
    if scan.faces is not None:
        np.testing.assert_array_equal(scan.faces, FACES)


def open3d_like(cloud: Any) -> Any:
    return SimpleNamespace(points=Vector(cloud.points), normals=Vector(np.empty((0, 3))))


SOURCE, TARGET = open3d_like(PAIR.source), open3d_like(PAIR.target)


def test_registration_is_the_same() -> None:
    expected = register(PAIR.source, PAIR.target, voxel=VOXEL).T_target_source
    np.testing.assert_array_equal(register(SOURCE, TARGET, voxel=VOXEL).T_target_source, expected)
    np.testing.assert_array_equal(
        register(prepare(SOURCE, voxel=VOXEL), Tensor(PAIR.target.points)).T_target_source, expected
    )
    (found,) = register_many([TARGET, SOURCE], voxel=VOXEL)
    assert found is not None
    np.testing.assert_array_equal(
        describe(SOURCE, descriptor="rcs").descriptors, describe(PAIR.source, descriptor="rcs").descriptors
    )


def test_a_mesh_of_another_library_is_a_model() -> None:
    pair = StandinClutter().load(StandinClutter().pair_names()[0])
    mesh = SimpleNamespace(vertices=Vector(pair.source.points), triangles=Vector(pair.source.faces))
    expected = prepare(pair.source, voxel=12.0, normals="mesh")
    np.testing.assert_array_equal(prepare(mesh, voxel=12.0, normals="mesh").normals, expected.normals)
    viewed = {"voxel": 12.0, "viewpoint": (0, 0, 0)}
    by_mesh = recognize({"a": mesh}, pair.target, **viewed)
    by_cloud = recognize({"a": pair.source}, pair.target, **viewed)
    assert [str(found) for found in by_mesh] == [str(found) for found in by_cloud]


def test_matches_groups_and_judgements_take_them() -> None:
    source, target = Tensor(PROBLEM.source, grad=True), Frame(["x", "y", "z"], PROBLEM.target)
    expected = cgroup.gc(PROBLEM.source, PROBLEM.target, resolution=PROBLEM.resolution)
    np.testing.assert_array_equal(
        cgroup.gc(source, target, resolution=PROBLEM.resolution).mask, expected.mask
    )
    matches = cgroup.Correspondences(source, target, ratio=Tensor(PROBLEM.ratio))
    np.testing.assert_array_equal(matches.target, PROBLEM.target)
    pose = Tensor(np.eye(4))
    np.testing.assert_array_equal(
        evaluation.match_errors(source, target, pose),
        evaluation.match_errors(PROBLEM.source, PROBLEM.target, np.eye(4)),
    )
    assert evaluation.overlap(SOURCE, SOURCE, np.eye(4), tolerance=1.0) == 1
    normals = features.normals(SOURCE)
    assert Surface(SOURCE, SimpleNamespace(points=normals), unit=VOXEL)


def test_files_nuisances_and_figures_take_them(tmp_path) -> None:
    io.write_cloud(tmp_path / "mesh.ply", STAND_INS["trimesh"])
    written = io.read_cloud(tmp_path / "mesh.ply")
    np.testing.assert_array_equal(written.points, POINTS)
    np.testing.assert_array_equal(written.faces, FACES)
    io.write_cloud(tmp_path / "array.ply", POINTS)
    io.write_keypoints(tmp_path / "keypoints.npz", STAND_INS["small_gicp"], [3, 4])
    rng = np.random.default_rng(0)
    noisy = nuisances.add_noise(STAND_INS["trimesh"], 0.0, rng)
    np.testing.assert_array_equal(noisy.points, POINTS)
    assert len(nuisances.decimate(TARGET, 0.5, rng)) == round(len(PAIR.target) / 2)
    assert keypoints_figure(TARGET, {"some": [1, 2]}, title="t").axes
    matches = cgroup.Correspondences(POINTS, POINTS)
    clouds = STAND_INS["tensor"], STAND_INS["ROS"]
    mask = np.ones(60, bool)
    assert registration_figure(*clouds, matches, mask=mask, T_target_source=np.eye(4), title="t").axes
    plt.close("all")


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        (Tensor(POINTS, device="cuda:0"), r"got a Tensor on cuda:0; copy it .*: \.cpu\(\)"),
        (SimpleNamespace(points=Tensor(POINTS, device="cuda:1")), r"on cuda:1; copy it"),
        (Frame(["a", "b", "c", "d"], POINTS[:, [0, 1, 2, 0]]), "got columns a, b, c, d; call three of them x, y"),
        (Frame(list("abcdefghij"), np.zeros((3, 10))), r"got columns a, .*, h, \.\.\.; call"),
        (Frame(["x", "X", "y", "z"], POINTS[:, [0, 1, 2, 0]]), "several columns called 'x'"),
        (np.zeros(3, [("a", float), ("b", float)]), "got columns a, b; call"),
        (SimpleNamespace(points=Vector(np.zeros((3, 4)))), r"got shape \(3,4\); give \(n,3\)"),
        (np.zeros((3, 4)), r"got shape \(3,4\); give \(n,3\)"),
        (SimpleNamespace(points=None), "got namespace.*; give .*Open3D, small_gicp"),
        ("cloud.ply", "got 'cloud.ply'; give .*a data frame with columns x, y, z"),
        (Mock(), "got a Mock on"),
        (MagicMock(), "cloud"),
    ],
)  # fmt: skip
def test_what_holds_no_points_is_refused_in_one_sentence(value: Any, reason: str) -> None:
    with pytest.raises(InputError, match=reason) as caught:
        features.Cloud(value, name="cloud")
    assert str(caught.value).startswith("cloud")
    assert len(str(caught.value)) < 500


def test_normals_and_faces_that_do_not_fit_are_refused_by_name() -> None:
    points = Vector(POINTS)
    with pytest.raises(InputError, match=r"cloud\.normals: got 3 for 60 points"):
        as_scan("cloud", SimpleNamespace(points=points, normals=Vector(NORMALS[:3])))
    with pytest.raises(InputError, match=r"cloud\.faces: got row 60"):
        as_scan("cloud", SimpleNamespace(vertices=points, triangles=Vector(FACES + 1)))


def test_the_packages_own_cloud_goes_in_too() -> None:
    cloud = PointCloud(POINTS, NORMALS)
    assert find_cloud("cloud", cloud) is cloud
    np.testing.assert_array_equal(features.Cloud(cloud).points, POINTS)
    np.testing.assert_array_equal(cgroup.Correspondences(cloud, features.Cloud(POINTS)).target, POINTS)
