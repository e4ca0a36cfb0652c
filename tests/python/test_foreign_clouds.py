"""Clouds of other libraries go in wherever arrays of points do, with their normals and faces.

The clouds are stand-ins with the same attributes, and the real ones where their libraries are installed.
"""

import importlib
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock, Mock

import numpy as np
import pytest
from matplotlib import pyplot as plt
from public_calls import PAIR, PROBLEM, VOXEL

import cgroup
from cgroup import evaluation, features, io, nuisances
from cgroup.datasets.generated.stones import StandinClutter
from cgroup.errors import InputError
from cgroup.plots import keypoints_figure, registration_figure
from cgroup.registration import describe, prepare, recognize, register, register_many
from cgroup.registration.scan import as_scan
from cgroup.types import PointCloud
from cgroup.types.point_cloud import find_cloud
from cgroup.verification import Surface


class Vector:
    """Open3D's Vector3dVector: a sequence that NumPy reads through the buffer protocol."""

    def __init__(self, values: Any) -> None:
        self.values = np.array(values)

    def __len__(self) -> int:
        return len(self.values)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.values, dtype=dtype)


class Tensor:
    """PyTorch's: NumPy may have it detached and on the CPU only; it has no bfloat16."""

    def __init__(self, values: Any, device: str = "cpu", dtype: str = "torch.float64", *, grad: bool = False):
        self.values, self.device, self.dtype, self.grad = np.array(values), device, dtype, grad

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return self.numpy()

    def __len__(self) -> int:
        return len(self.values)

    def cpu(self) -> "Tensor":
        return Tensor(self.values, "cpu", self.dtype, grad=self.grad)

    def detach(self) -> "Tensor":
        return Tensor(self.values, self.device, self.dtype)

    def float(self) -> "Tensor":
        return Tensor(self.values.astype(np.float32), self.device, "torch.float32", grad=self.grad)

    def numpy(self) -> np.ndarray:
        if self.grad:
            message = "Can't call numpy() on Tensor that requires grad."
            raise RuntimeError(message)
        if self.device != "cpu" or self.dtype == "torch.bfloat16":
            message = "can't convert"
            raise TypeError(message)
        return self.values


class OnlyDlpack:
    """What has the common exchange of tensors and nothing else."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = values

    def __dlpack__(self, **options: Any) -> Any:
        return self.values.__dlpack__(**options)

    def __dlpack_device__(self) -> Any:
        return self.values.__dlpack_device__()


class TensorMap(dict):
    """Open3D's map of tensors, which has no `get`."""

    get = None


class Frame:
    """A table with named columns, as pandas, polars and pyarrow have it."""

    def __init__(self, names: list[Any], columns: np.ndarray) -> None:
        self.columns = names
        self._columns = dict(enumerate(np.transpose(columns)))

    def __getitem__(self, name: Any) -> Any:
        return SimpleNamespace(to_numpy=lambda: self._columns[self.columns.index(name)])

    def __len__(self) -> int:
        return len(self._columns[0])


def homogeneous(vectors: np.ndarray, last: float) -> np.ndarray:
    return np.column_stack([vectors, np.full(len(vectors), last)])


def small_gicp(points: np.ndarray, normals: np.ndarray) -> Any:
    return SimpleNamespace(
        points=lambda: homogeneous(points, 1), normals=lambda: homogeneous(normals, 0), point=lambda row: row
    )


def message(points: np.ndarray) -> Any:
    """PointCloud2 with a field between, padding after every point and after every row."""
    height, width = 2, len(points) // 2
    record = np.dtype(
        {"names": ["x", "y", "z", "i"], "formats": ["<f4"] * 3 + ["<u2"], "offsets": [4, 8, 16, 0]}
        | {"itemsize": 24}
    )
    content = bytearray(height * (24 * width + 5))
    for row in range(height):
        records = np.zeros(width, record)
        for axis, name in enumerate("xyz"):
            records[name] = points[row * width : (row + 1) * width, axis]
        start = row * (24 * width + 5)
        content[start : start + 24 * width] = records.tobytes()
    kinds = {"x": 7, "y": 7, "z": 7, "i": 4}
    fields = [
        SimpleNamespace(name=name, offset=record.fields[name][1], datatype=kind, count=1)
        for name, kind in kinds.items()
    ]
    return SimpleNamespace(
        fields=fields, height=height, width=width, point_step=24, row_step=24 * width + 5,
        is_bigendian=False, data=bytes(content),
    )  # fmt: skip


def stand_ins(points: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> dict[str, Any]:
    """Clouds of all kinds, by name; each holds the same points."""
    records = np.zeros(len(points), [("z", float), ("X", float), ("y", float), ("intensity", int)])
    records["X"], records["y"], records["z"] = points.T
    nothing = Vector(np.empty((0, 3)))
    return {
        "Open3D cloud": SimpleNamespace(points=Vector(points), normals=nothing, colors=nothing),
        "Open3D cloud with normals": SimpleNamespace(points=Vector(points), normals=Vector(normals)),
        "Open3D mesh": SimpleNamespace(vertices=Vector(points), triangles=Vector(faces)),
        "Open3D tensors": SimpleNamespace(point=TensorMap(positions=Tensor(points), normals=Tensor(normals))),
        "Open3D mesh of tensors": SimpleNamespace(
            vertex=TensorMap(positions=Tensor(points)), triangle=TensorMap(indices=Tensor(faces))
        ),
        "small_gicp": small_gicp(points, normals),
        "trimesh": SimpleNamespace(vertices=points, faces=faces, triangles=points[faces]),
        "PyVista": SimpleNamespace(
            points=points, faces=np.column_stack([np.full(len(faces), 3), faces]).ravel(), regular_faces=faces
        ),
        "PyVista with normals": SimpleNamespace(points=points, point_data={"Normals": normals}),
        "laspy": SimpleNamespace(xyz=points, points=records, x=points[:, 0]),
        "ROS": message(points),
        "pandas": Frame(["intensity", "Z", "x", "Y"], points[:, [0, 2, 0, 1]]),
        "three columns": Frame([0, 1, 2], points),
        "pandas with normals": Frame(["x", "y", "z", "nx", "ny", "nz"], np.hstack([points, normals])),
        "PCL's names": Frame(
            ["x", "y", "z", "normal_x", "normal_y", "normal_z"], np.hstack([points, normals])
        ),
        "CloudCompare's names": Frame(["//X", "Y", "Z", "R"], points[:, [0, 1, 2, 0]]),
        "records": records,
        "tensor": Tensor(points),
        "tensor with a gradient": Tensor(points, grad=True),
        "brain floats": Tensor(points, dtype="torch.bfloat16"),
        "DLPack": OnlyDlpack(points),
        "not contiguous": points[::-1].T.copy().T[::-1],
    }


def real_clouds(points: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> dict[str, Callable[[], Any]]:
    """Makers of the real ones, by library and kind; they raise ImportError where it isn't installed."""

    def of(library: str, make: Callable[[Any], Any]) -> Callable[[], Any]:
        return lambda: make(importlib.import_module(library))

    def open3d_cloud(o3d: Any) -> Any:
        cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        cloud.normals = o3d.utility.Vector3dVector(normals)
        return cloud

    def open3d_mesh(o3d: Any) -> Any:
        corners = o3d.utility.Vector3dVector(points), o3d.utility.Vector3iVector(faces)
        return o3d.geometry.TriangleMesh(*corners)

    def estimated(gicp: Any) -> Any:
        cloud = gicp.PointCloud(points)
        gicp.estimate_normals(cloud)
        return cloud

    padded = np.column_stack([np.full(len(faces), 3), faces])
    return {
        "Open3D cloud": of("open3d", open3d_cloud),
        "Open3D mesh": of("open3d", open3d_mesh),
        "Open3D tensors": of("open3d", lambda o3d: o3d.t.geometry.PointCloud.from_legacy(open3d_cloud(o3d))),
        "Open3D mesh of tensors": of(
            "open3d", lambda o3d: o3d.t.geometry.TriangleMesh.from_legacy(open3d_mesh(o3d))
        ),
        "Open3D tensor": of("open3d", lambda o3d: o3d.core.Tensor(points)),
        "small_gicp": of("small_gicp", estimated),
        "small_gicp without normals": of("small_gicp", lambda gicp: gicp.PointCloud(points)),
        "trimesh": of("trimesh", lambda trimesh: trimesh.Trimesh(points, faces, process=False)),
        "trimesh cloud": of("trimesh", lambda trimesh: trimesh.PointCloud(points)),
        "PyVista": of("pyvista", lambda pyvista: pyvista.PolyData(points, padded)),
        "PyVista cloud": of("pyvista", lambda pyvista: pyvista.PolyData(points)),
        "pandas": of("pandas", lambda pandas: pandas.DataFrame(points[:, ::-1], columns=["Z", "Y", "X"])),
        "polars": of("polars", lambda polars: polars.DataFrame(points, schema=["x", "y", "z"])),
        "pyarrow": of("pyarrow", lambda arrow: arrow.table(dict(zip("xyz", points.T.copy(), strict=True)))),
        "torch": of("torch", lambda torch: torch.tensor(points, requires_grad=True)),
        "torch brain floats": of("torch", lambda torch: torch.tensor(points, dtype=torch.bfloat16)),
    }


POINTS = np.random.default_rng(0).normal(size=(60, 3)).astype(np.float32).astype(np.float64)
NORMALS = POINTS / np.linalg.norm(POINTS, axis=1, keepdims=True)
FACES = np.arange(60).reshape(20, 3)
STAND_INS = stand_ins(POINTS, NORMALS, FACES)
REAL = real_clouds(POINTS, NORMALS, FACES)

WITH_NORMALS = {"Open3D tensors", "PCL's names"} | {kind for kind in STAND_INS if "with normals" in kind}
WITH_FACES = {"Open3D mesh", "Open3D mesh of tensors", "trimesh", "PyVista"}


def assert_is_read(cloud: Any, atol: float, *, normals: bool, faces: bool) -> None:
    """Points, normals and faces are those of the cloud."""
    np.testing.assert_allclose(features.Cloud(cloud).points, POINTS, atol=atol)
    scan = as_scan("cloud", cloud)
    assert (scan.normals is not None, scan.faces is not None) == (normals, faces)
    if scan.normals is not None:
        np.testing.assert_allclose(scan.normals, NORMALS, rtol=0, atol=atol)
    if scan.faces is not None:
        np.testing.assert_array_equal(scan.faces, FACES)


@pytest.mark.parametrize("kind", STAND_INS)
def test_stand_ins_are_read(kind: str) -> None:
    atol = 0.02 if "brain" in kind else 0
    assert_is_read(STAND_INS[kind], atol, normals=kind in WITH_NORMALS, faces=kind in WITH_FACES)


@pytest.mark.parametrize("kind", REAL)
@pytest.mark.filterwarnings("default")
def test_the_libraries_own_clouds_are_read(kind: str) -> None:
    try:
        cloud = REAL[kind]()
    except ImportError as error:
        pytest.skip(f"{error.name} is not installed; install it to try its clouds")
    atol = 0.02 if "brain" in kind else 1e-6  # Open3D's tensors are float32
    normals = kind in {"Open3D cloud", "Open3D tensors"}
    assert_is_read(cloud, atol, normals=normals, faces=kind in WITH_FACES)


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
    assert Surface(SOURCE, Tensor(normals), unit=VOXEL)


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
        ("cloud.ply", "cloud.ply: no such file"),
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
